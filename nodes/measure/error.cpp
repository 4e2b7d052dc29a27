// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/registry.h"
#include "rayloom/stats/error_measures.h"

#include <algorithm>
#include <array>

namespace rayloom
{
namespace
{

/// Rows measured at a time, to bound what one call allocates.
constexpr int strip_rows = 32;

/// The colour channels of a view as one view: without a copy where they are evenly spaced in
/// memory (R G B, B G R, one channel), else copied into `copy`.
ConstImageView colour_view(const ConstImageView& view, const std::vector<int>& channels,
                           ImageBuffer& copy)
{
    const int n = static_cast<int>(channels.size());
    const int step = n > 1 ? channels[1] - channels[0] : 1;
    bool even = true;
    for (int i = 1; i < n; ++i)
        even = even && channels[static_cast<std::size_t>(i)] == channels[0] + i * step;
    if (even)
        return {view.data() + channels[0] * view.channel_stride(), view.region(), n,
                view.row_stride(), step * view.channel_stride()};
    copy = ImageBuffer(view.region(), n);
    for (int i = 0; i < n; ++i)
        copy_pixels(view.channel_range(channels[static_cast<std::size_t>(i)], 1),
                    copy.view().channel_range(i, 1));
    return copy.view();
}

/// measure.error: figures and a map of the difference between an image and its reference.
class MeasureError final : public Node
{
public:
    struct Params {
        std::string map = "flip";
        bool ssim = true;
        bool flip = true;
        double pixels_per_degree = flip_pixels_per_degree;
    };

    static void describe(Declaration<Params>& d);
    explicit MeasureError(const Params& p) : m_params(p) {}

    void plan(PlanContext& context) override;
    void reduce(const TileContext& row, std::span<double> sums) const override;
    void combine(std::span<double> into, std::span<const double> other) const override
    {
        ErrorMeter::combine(into, other);
    }
    std::map<std::string, Table, std::less<>> finish(std::span<const double> totals,
                                                     std::span<const TileContext::Input>) override;
    void compute(const TileContext& context) const override;

private:
    ImagePair pair(const TileContext& context, std::array<ImageBuffer, 2>& copies) const
    {
        return {colour_view(context.input("image"), m_image_channels, copies[0]),
                colour_view(context.input("reference"), m_reference_channels, copies[1]), m_window};
    }

    Params m_params;
    ErrorMap m_map = ErrorMap::flip;
    Region m_window;
    std::vector<int> m_image_channels, m_reference_channels;
    std::optional<ErrorMeter> m_meter;
};

void MeasureError::describe(Declaration<Params>& d)
{
    d.name("measure.error")
        .summary("Measures how far an image is from its reference.")
        .doc(
            "Works on the colour channels (R, G, B, or the only channel) of linear radiance; alpha "
            "is not looked at. Figures: rmse, relmse, psnr, psnr_clamped, smape, max_abs_error, "
            "brightness_ratio, ssim, flip, pixels and non_finite_pixels. Pixels with a NaN or an "
            "infinity in either image are counted and left out. SSIM and FLIP see the radiance "
            "clamped to [0, 1]. HDR-FLIP and the trimmed relMSE need whole images at hand: "
            "`rayloom compare` has them. Definitions and constants: docs/measures.md.")
        .source("MATH.md, error measures; FLIP: Andersson et al. 2020; SSIM: Wang et al. 2004; "
                "PSNR as in 004_ae1655312894f2a2.txt, section 5")
        .accuracy("All sums in double; within 1e-6 (relative) of a second implementation.")
        .example("rayloom: 1\n"
                 "name: error\n"
                 "inputs:\n"
                 "  image: {doc: the image to judge}\n"
                 "  reference: {doc: what it should be}\n"
                 "nodes:\n"
                 "  error: {op: measure.error, image: image, reference: reference, map: flip}\n"
                 "outputs:\n"
                 "  map: error.map\n");
    d.input("image", "Linear radiance, one or three colour channels.");
    d.input("reference", "What the image should be; same data window and colour channels.");
    d.output("errors", "One row of figures.").table().optional();
    d.output("map", "Error of each pixel, one channel `Y`; 0 where a pixel is left out.")
        .optional();
    d.param("map", &Params::map,
            "What the map shows: mean |d−r|, mean (d−r)²/(r²+0.01), or FLIP in [0, 1].")
        .choices({"absolute", "relative", "flip"});
    d.param("ssim", &Params::ssim, "Measure SSIM.");
    d.param("flip", &Params::flip, "Measure mean FLIP (the slowest figure).");
    d.param("pixels_per_degree", &Params::pixels_per_degree,
            "Viewing distance of FLIP: pixels per degree of visual angle.")
        .range(1.0, 1000.0)
        .unit("px/°");
}

void MeasureError::plan(PlanContext& context)
{
    context.require_same_window("image", "reference");
    const ImageDesc& image = context.input("image");
    m_window = image.data;
    m_image_channels = image.colour();
    m_reference_channels = context.input("reference").colour();
    const std::size_t n = m_image_channels.size();
    if ((n != 1 && n != 3) || m_reference_channels.size() != n)
        throw NodeError("image has " + std::to_string(n) + " colour channels and reference " +
                        std::to_string(m_reference_channels.size()) +
                        "; both must have R, G, B or one channel (select them with "
                        "oiio.channels)");

    m_map = m_params.map == "absolute"   ? ErrorMap::absolute
            : m_params.map == "relative" ? ErrorMap::relative
                                         : ErrorMap::flip;
    ErrorOptions options;
    options.ssim = m_params.ssim;
    options.flip = m_params.flip;
    options.hdr_flip = false;
    options.pixels_per_degree = m_params.pixels_per_degree;
    m_meter.emplace(options);

    context.output("map", image.with_channels({"Y"}));
    const Halo map_halo = Halo::all(m_meter->map_halo(m_map));
    const Halo row_halo{0, 0, m_meter->halo_rows(), m_meter->halo_rows()};
    for (const char* port : {"image", "reference"}) {
        if (!map_halo.none()) context.needs(port, map_halo);
        context.reduce_needs(port, row_halo);
    }
    context.reduce(m_window, ErrorMeter::sum_count);
    // Opponent colours of both images with the halo, in double, and the result.
    const auto rows = static_cast<std::size_t>(strip_rows + 2 * map_halo.up);
    context.scratch(rows * static_cast<std::size_t>(m_window.width() + 2 * map_halo.left) * 7 *
                    sizeof(double));
}

void MeasureError::reduce(const TileContext& row, std::span<double> sums) const
{
    std::array<ImageBuffer, 2> copies;
    std::vector<double> record(ErrorMeter::sum_count);
    m_meter->add_rows(pair(row, copies), row.region().y0, row.region().y1, record);
    if (const std::size_t bad = ErrorMeter::left_out(record); bad > 0)
        row.count("pixels left out (not finite)", bad);
    ErrorMeter::combine(sums, record);
}

std::map<std::string, Table, std::less<>> MeasureError::finish(std::span<const double> totals,
                                                               std::span<const TileContext::Input>)
{
    const ErrorMeasures measures =
        m_meter->measures(totals, static_cast<int>(m_image_channels.size()));
    if (measures.pixels == 0)
        throw InputError("no pixel is finite in both images; there is nothing to measure");
    return {{"errors", measures.table()}};
}

void MeasureError::compute(const TileContext& context) const
{
    if (!context.wants("map")) return;
    std::array<ImageBuffer, 2> copies;
    const ImagePair images = pair(context, copies);
    const Region& region = context.region();
    for (int y = region.y0; y < region.y1; y += strip_rows) {
        context.check_cancelled();
        const Region strip{region.x0, y, region.x1, std::min(y + strip_rows, region.y1)};
        m_meter->map(images, m_map, context.output("map").crop(strip));
    }
}

RAYLOOM_NODE(MeasureError);

} // namespace
} // namespace rayloom

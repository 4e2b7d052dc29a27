// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/histogram_kernel.h"

#include "rayloom/core/registry.h"
#include "rayloom/core/text.h"

#include <cmath>
#include <cstring>
#include <string>

namespace rayloom
{

namespace
{

/// Whether the colour of `region` is +0 everywhere and its alpha finite.
bool is_black(ConstImageView image, const Region& region, int alpha)
{
    for (int y = region.y0; y < region.y1; ++y)
        for (int c = 0; c < image.channels(); ++c) {
            const float* p = image.ptr(c, region.x0, y);
            for (int x = 0; x < region.width(); ++x) {
                if (c == alpha ? !std::isfinite(p[x]) : p[x] != 0.0f || std::signbit(p[x]))
                    return false;
            }
        }
    return true;
}

} // namespace

/// Averages patches whose pixels have the same distribution of ray colours.
class FuseHistogram final : public Node
{
public:
    struct Params {
        float kappa = 1.0f;
        int window = 13;
        int patch = 3;
        int min_patches = 0;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("fuse.histogram")
            .summary("Average the patches of a search window whose ray histograms match.")
            .doc("Two patches match when the χ² of their pixels' histograms, pooled over the patch "
                 "and divided by the number of bins that hold evidence (a sum above one sample), "
                 "is below `kappa`. Counts may differ from pixel to pixel. Every pixel of a patch "
                 "becomes the plain mean over the matching patches, and every pixel the mean of "
                 "the estimates of the patches it lies in.\n\n"
                 "Near the border of the data window the patch of a pixel shrinks to what fits "
                 "between it and the border, and the window is clipped. A pixel that shares with "
                 "nobody keeps its value to the last bit. The result is a mean of input pixels: it "
                 "is never outside their range.\n\n"
                 "With an alpha channel the colour is premultiplied: each contribution weighs as "
                 "much as its alpha, the result is premultiplied with the pixel's own alpha, alpha "
                 "itself passes through, and where it is 0 so does the colour. NaN and infinity "
                 "in a histogram never match; in the image they spread to the pixels that match "
                 "theirs (threshold.sanitize removes them).")
            .source("004_ae1655312894f2a2.txt, equations 3 and 4, Algorithm 1")
            .accuracy("Float against the double oracle: 3e-6 relative, but for pairs within 1e-6 "
                      "of kappa, which may fall on either side of it.")
            .example("rayloom: 1\n"
                     "name: fuse-example\n"
                     "doc: Denoise with ray histograms at one scale.\n"
                     "inputs:\n"
                     "  color: {doc: noisy radiance, channels: RGB}\n"
                     "  histogram: {doc: ray histogram of the same frame}\n"
                     "nodes:\n"
                     "  fused: {op: fuse.histogram, image: color, histogram: histogram, "
                     "kappa: 0.8, min_patches: 2}\n"
                     "outputs:\n"
                     "  image: fused\n");
        d.input("image", "linear radiance; every channel but alpha is averaged");
        d.input("histogram", "bins of every colour channel, then the number of samples as last "
                             "channel (transform.histogram)");
        d.output("image", "the fused image");
        d.output("matches", "accepted patches of each pixel, its own included").optional();
        d.param("kappa", &Params::kappa,
                "threshold on pooled χ² per used bin; about 1 for one path a sample, 0.4 to 0.6 "
                "when a sample is already a mean of several")
            .min(0)
            .source("004_ae1655312894f2a2.txt, section 4");
        d.param("window", &Params::window, "side of the search window, odd")
            .range(1, 101)
            .unit("px");
        d.param("patch", &Params::patch, "side of a patch, odd").range(1, 15).unit("px");
        d.param("min_patches", &Params::min_patches,
                "nearest patches kept besides the pixel's own, match or not; they help fireflies "
                "at the finest scale")
            .range(0, 64);
    }

    explicit FuseHistogram(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        if (m.window % 2 == 0)
            throw NodeError("window must be odd, so that it has a centre; " +
                            std::to_string(m.window) + " is not: try " +
                            std::to_string(m.window + 1));
        if (m.patch % 2 == 0)
            throw NodeError("patch must be odd, so that it has a centre; " +
                            std::to_string(m.patch) + " is not: try " +
                            std::to_string(m.patch + 1));
        context.require_same_window("image", "histogram");
        const ImageDesc& image = context.input("image");
        const ImageDesc& histogram = context.input("histogram");
        if (histogram.channel_count() < 2)
            throw NodeError("input 'histogram' has " + std::to_string(histogram.channel_count()) +
                            " channel; a histogram has its bins and, last, the number of samples");
        if (histogram.colour().size() == 3 && histogram.channel_count() <= 4 &&
            histogram.channel("R") >= 0)
            throw NodeError("input 'histogram' has channels " + join_names(histogram.channels) +
                            ": that is a picture; a histogram has its bins and, last, the number "
                            "of samples");
        m_alpha = image.alpha();
        if (image.channel_count() - (m_alpha >= 0 ? 1 : 0) < 1)
            throw NodeError("input 'image' has no channel to average besides alpha");
        m_data = image.data;
        m_settings.kappa = m.kappa;
        m_settings.window_radius = m.window / 2;
        m_settings.patch_radius = m.patch / 2;
        m_settings.min_patches = m.min_patches;

        context.output("image", image);
        context.output("matches", image.with_channels({"matches"}));
        context.needs("image", Halo::all(m_settings.window_radius));
        context.needs("histogram", Halo::all(histogram_fusion_reach(m_settings)));
        context.scratch(
            histogram_fusion_scratch(m_settings, histogram.channel_count(), image.channel_count()));
        const bool alone = (m.kappa == 0.0f && m.min_patches == 0) || m.window == 1;
        if (alone || context.black("image")) context.pass_through("image", "image");
        if (alone) context.constant("matches", 1.0f);
        if (m_alpha >= 0) context.pass_channel("image", m_alpha, "image", m_alpha);
    }

    void compute(const TileContext& context) const override
    {
        const Region& region = context.region();
        ImageView out, matches;
        if (context.wants("image")) out = context.output("image");
        if (context.wants("matches")) matches = context.output("matches");
        const ConstImageView image = context.input("image");
        if (context.may_skip() && !out.empty() && matches.empty() &&
            is_black(image, region.grown(Halo::all(m_settings.window_radius)).intersect(m_data),
                     m_alpha)) {
            copy_pixels(image.crop(region), out);
            context.count_skip("black", region.pixels());
            return;
        }
        fuse_histogram(m_settings, m_data, context.input("histogram"), image, m_alpha, out, matches,
                       [&] { context.check_cancelled(); });
    }

private:
    Params m;
    HistogramFusionSettings m_settings;
    Region m_data;
    int m_alpha = -1;
};

RAYLOOM_NODE(FuseHistogram);

} // namespace rayloom

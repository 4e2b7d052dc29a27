// SPDX-License-Identifier: Apache-2.0
#include "nodes/multiscale/resample.h"

#include "rayloom/core/registry.h"

#include <string>

namespace rayloom
{

/// An image at several scales, each made from the full resolution.
class Pyramid final : public Node
{
public:
    struct Params {
        int scales = 2;
        std::string conserve = "none";
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("multiscale.pyramid")
            .summary("Gaussian scales of an image, each half the size of the one before.")
            .doc("Element 0 is the image itself. Element s is filtered by a Gaussian of "
                 "0.55·√(4^s − 1) px and sampled at the centre of every block of 2^s × 2^s pixels, "
                 "always from the full resolution. Its size is ⌈size / 2^s⌉ and its data window "
                 "starts at (0, 0) whatever the image's does; block (0, 0) is the first of the "
                 "data window. Beyond the border the image is mirrored. Premultiplied colour is "
                 "filtered as it is, which keeps it premultiplied.\n\n"
                 "With `conserve: sum` every channel of a level is multiplied by (sum of the last "
                 "channel at full resolution) / (its sum at that level). For ray histograms, whose "
                 "last channel is the sample count, the level then holds as many samples as the "
                 "image, which is what the χ² test of two averaged histograms needs.")
            .source("004_ae1655312894f2a2.txt, section 3.4, Algorithm 2 lines 2, 4 and 5")
            .accuracy("Float against the double oracle: 1e-6 of the largest value nearby.")
            .example("rayloom: 1\n"
                     "name: pyramid-example\n"
                     "doc: Two scales of an image, put together again.\n"
                     "inputs:\n"
                     "  color: {doc: linear radiance, channels: RGB}\n"
                     "nodes:\n"
                     "  levels: {op: multiscale.pyramid, image: color, scales: 2}\n"
                     "  whole: {op: multiscale.recombine, levels: levels}\n"
                     "outputs:\n"
                     "  image: whole\n");
        d.input("image", "any channels");
        d.output("levels", "the scales, finest first").list();
        d.param("scales", &Params::scales, "number of levels, the image itself included")
            .range(1, 8)
            .source("004_ae1655312894f2a2.txt, Algorithm 2 (n_s)");
        d.param("conserve", &Params::conserve,
                "sum: every level holds as many samples (last channel) as the image")
            .choices({"none", "sum"});
    }

    explicit Pyramid(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& image = context.input("image");
        m_data = image.data;
        m_factors.assign(static_cast<std::size_t>(m.scales), 1.0f);
        std::vector<ImageDesc> levels{image};
        for (int s = 1; s < m.scales; ++s) {
            ImageDesc level = image;
            level.data = {0, 0, decimated_size(m_data.width(), s),
                          decimated_size(m_data.height(), s)};
            level.display = level.data;
            levels.push_back(std::move(level));
        }
        context.output_list("levels", std::move(levels));
        context.pass_through("levels", "image", 0, 0);
        context.needs("image", [data = m_data](const Need& need) {
            const int s = static_cast<int>(need.output_element);
            if (s == 0) return need.region;
            const auto h = decimate_axis(data.width(), s, need.region.x0, need.region.x1);
            const auto v = decimate_axis(data.height(), s, need.region.y0, need.region.y1);
            return Region{h.source_begin, v.source_begin, h.source_end, v.source_end}.shifted(
                data.x0, data.y0);
        });
        if (m.conserve == "sum" && m.scales > 1) {
            m_last_channel = image.channel_count() - 1;
            m_columns.resize(m_factors.size());
            m_rows.resize(m_factors.size());
            for (int s = 1; s < m.scales; ++s) {
                m_columns[static_cast<std::size_t>(s)] = total_weights(m_data.width(), s);
                m_rows[static_cast<std::size_t>(s)] = total_weights(m_data.height(), s);
            }
            context.reduce(m_data, m_factors.size());
            context.reduce_needs("image");
        }
    }

    void reduce(const TileContext& row, std::span<double> sums) const override
    {
        // The sum of a level is linear in the full resolution: what matters of a pixel is the
        // weight it has in all pixels of the level together.
        const int y = row.region().y0;
        const float* count = row.input("image").ptr(m_last_channel, m_data.x0, y);
        const auto width = static_cast<std::size_t>(m_data.width());
        for (std::size_t x = 0; x < width; ++x) sums[0] += count[x];
        for (std::size_t s = 1; s < sums.size(); ++s) {
            double sum = 0.0;
            for (std::size_t x = 0; x < width; ++x) sum += m_columns[s][x] * count[x];
            sums[s] += sum * m_rows[s][static_cast<std::size_t>(y - m_data.y0)];
        }
    }

    std::map<std::string, Table, std::less<>> finish(std::span<const double> totals,
                                                     std::span<const TileContext::Input>) override
    {
        for (std::size_t s = 1; s < totals.size(); ++s)
            if (totals[s] > 0.0) m_factors[s] = static_cast<float>(totals[0] / totals[s]);
        return {};
    }

    void compute(const TileContext& context) const override
    {
        const Region& region = context.region();
        const ImageView out = context.output("levels");
        const ConstImageView image = context.input("image");
        const int s = static_cast<int>(context.element());
        context.check_cancelled();
        if (s == 0) {
            copy_pixels(image, out);
            return;
        }
        resample(image, {m_data.x0, m_data.y0},
                 decimate_axis(m_data.width(), s, region.x0, region.x1),
                 decimate_axis(m_data.height(), s, region.y0, region.y1),
                 m_factors[context.element()], out, {});
    }

private:
    /// Weight of each source pixel of an axis in all pixels of level `scale` together.
    static std::vector<double> total_weights(int size, int scale)
    {
        const ResampleAxis axis = decimate_axis(size, scale, 0, decimated_size(size, scale));
        std::vector<double> total(static_cast<std::size_t>(size), 0.0);
        for (std::size_t i = 0; i < axis.source.size(); ++i)
            total[static_cast<std::size_t>(axis.source[i])] += axis.weight[i];
        return total;
    }

    Params m;
    Region m_data;
    int m_last_channel = 0;
    std::vector<float> m_factors;                       ///< per level
    std::vector<std::vector<double>> m_columns, m_rows; ///< [level][pixel of the axis]
};

RAYLOOM_NODE(Pyramid);

} // namespace rayloom

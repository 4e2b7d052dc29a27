// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"

#include <algorithm>
#include <string>

namespace rayloom
{

/// Mean, variance and number of each pixel's samples.
class Statistics final : public Node
{
public:
    struct Params {
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.statistics")
            .summary("Mean, sample variance and count of each pixel's samples.")
            .doc("A sample is one image of a stack of renders that differ in their seed, or one "
                 "sample of a deep pixel. The variance is that of single samples, unbiased "
                 "(divided by n − 1); divide by the count for the variance of the mean. The order "
                 "of the images changes nothing beyond rounding. The mean keeps alpha when every "
                 "image has one. NaN and infinity go into the pixel's figures (threshold.sanitize "
                 "removes them).\n\n"
                 "A deep pixel with one sample has variance 0, without any sample mean and "
                 "variance 0; such pixels are counted in the report.")
            .source("Welford 1962, Note on a method for calculating corrected sums of squares and "
                    "products")
            .accuracy("Accumulated in double; exact to float rounding.")
            .example("rayloom: 1\n"
                     "name: statistics-example\n"
                     "doc: Mean and variance of renders that differ in their random seed.\n"
                     "inputs:\n"
                     "  stack: {doc: renders of one frame, kind: list, channels: RGB}\n"
                     "nodes:\n"
                     "  statistics: {op: transform.statistics, stack: stack}\n"
                     "outputs:\n"
                     "  image: statistics.mean\n"
                     "  variance: statistics.variance\n");
        d.input("stack", "renders of one frame that differ in their seed").list().optional();
        d.input("deep", "deep image with one sample for every light path").deep().optional();
        d.output("mean", "mean of the samples; colour and alpha").optional();
        d.output("variance", "unbiased variance of one sample; colour").optional();
        d.output("count", "number of samples, one channel").optional();
    }

    explicit Statistics(const Params&) {}

    void plan(PlanContext& context) override
    {
        if (context.has("stack") == context.has("deep"))
            throw NodeError("connect either 'stack' or 'deep'");
        const char* port = context.has("stack") ? "stack" : "deep";
        const std::size_t images = context.count(port);
        if (context.has("stack") && images < 2)
            throw NodeError("a stack of " + std::to_string(images) +
                            (images == 1 ? " image has" : " images has") +
                            " no variance; render the frame at least twice, with different seeds");
        const ImageDesc& first = context.input(port);
        bool alpha = true;
        for (std::size_t i = 0; i < images; ++i)
            alpha = alpha && context.input(port, i).alpha() >= 0;
        m_channels.clear();
        for (std::size_t i = 0; i < images; ++i) {
            const ImageDesc& image = context.input(port, i);
            m_channels.push_back(image.colour());
            if (i > 0 && m_channels[i].size() + (alpha ? 1u : 0u) != m_channels[0].size())
                throw NodeError("image " + std::to_string(i) + " of the stack has " +
                                std::to_string(m_channels[i].size()) +
                                " colour channels, image 0 has " +
                                std::to_string(m_channels[0].size() - (alpha ? 1u : 0u)));
            if (alpha) m_channels[i].push_back(image.alpha());
            context.require_same_window(port, port, 0, i);
        }
        m_colours = m_channels[0].size() - (alpha ? 1 : 0);
        if (m_colours == 0)
            throw NodeError("input '" + std::string(port) + "' has no colour channel");
        std::vector<std::string> names = channel_names(first, m_channels[0]);
        context.output("mean", first.with_channels(names));
        names.resize(m_colours);
        context.output("variance", first.with_channels(names));
        context.output("count", first.with_channels({"count"}));
        if (context.has("stack")) context.constant("count", static_cast<float>(images));
    }

    void compute(const TileContext& context) const override
    {
        const Region& region = context.region();
        const auto width = static_cast<std::size_t>(region.width());
        std::vector<double> mean(width), squares(width);
        std::size_t few = 0;
        for (int y = region.y0; y < region.y1; ++y) {
            context.check_cancelled();
            for (std::size_t c = 0; c < m_channels[0].size(); ++c) {
                std::fill(mean.begin(), mean.end(), 0.0);
                std::fill(squares.begin(), squares.end(), 0.0);
                if (context.has("deep")) {
                    accumulate_deep(context.deep("deep"), m_channels[0][c], y, region, mean,
                                    squares);
                } else {
                    accumulate(context, c, y, mean, squares);
                }
                const auto channel = static_cast<int>(c);
                if (context.wants("mean")) {
                    float* to = context.output("mean").row(channel, y);
                    for (std::size_t x = 0; x < width; ++x) to[x] = static_cast<float>(mean[x]);
                }
                if (context.wants("variance") && c < m_colours) {
                    float* to = context.output("variance").row(channel, y);
                    for (std::size_t x = 0; x < width; ++x) to[x] = static_cast<float>(squares[x]);
                }
            }
            if (context.has("deep")) {
                const DeepView deep = context.deep("deep");
                const DeepRow& row = deep.row(y);
                for (std::size_t x = 0; x < width; ++x) {
                    const auto n = row.pixel(m_channels[0][0],
                                             region.x0 - deep.region.x0 + static_cast<int>(x))
                                       .size();
                    if (n < 2) ++few;
                    if (context.wants("count"))
                        context.output("count").row(0, y)[x] = static_cast<float>(n);
                }
            } else if (context.wants("count")) {
                std::fill_n(context.output("count").row(0, y), region.width(),
                            static_cast<float>(m_channels.size()));
            }
        }
        if (few > 0) context.count("pixels with fewer than two samples", few);
    }

private:
    /// Welford's update, image by image; leaves the variance in `squares`.
    void accumulate(const TileContext& context, std::size_t channel, int y,
                    std::vector<double>& mean, std::vector<double>& squares) const
    {
        for (std::size_t i = 0; i < m_channels.size(); ++i) {
            const float* sample =
                context.input("stack", i).ptr(m_channels[i][channel], context.region().x0, y);
            const double share = 1.0 / static_cast<double>(i + 1);
            for (std::size_t x = 0; x < mean.size(); ++x) {
                const double delta = sample[x] - mean[x];
                mean[x] += delta * share;
                squares[x] += delta * (sample[x] - mean[x]);
            }
        }
        const double share = 1.0 / static_cast<double>(m_channels.size() - 1);
        for (double& s : squares) s *= share;
    }

    static void accumulate_deep(const DeepView& deep, int channel, int y, const Region& region,
                                std::vector<double>& mean, std::vector<double>& squares)
    {
        const DeepRow& row = deep.row(y);
        for (int x = region.x0; x < region.x1; ++x) {
            const auto at = static_cast<std::size_t>(x - region.x0);
            const auto samples = row.pixel(channel, x - deep.region.x0);
            for (std::size_t i = 0; i < samples.size(); ++i) {
                const double delta = samples[i] - mean[at];
                mean[at] += delta / static_cast<double>(i + 1);
                squares[at] += delta * (samples[i] - mean[at]);
            }
            if (samples.size() > 1) squares[at] /= static_cast<double>(samples.size() - 1);
        }
    }

    std::vector<std::vector<int>> m_channels; ///< [image]: colour, then alpha
    std::size_t m_colours = 0;
};

RAYLOOM_NODE(Statistics);

} // namespace rayloom

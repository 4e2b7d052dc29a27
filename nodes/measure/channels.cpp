// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/registry.h"
#include "rayloom/stats/moments.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace rayloom
{
namespace
{

/// What is known of one channel: the numbers a reduction carries, and what they mean.
struct ChannelFigures {
    static constexpr std::size_t size = 7;

    Moments<> moments; ///< of the finite values
    double lowest = std::numeric_limits<double>::infinity();
    double highest = -std::numeric_limits<double>::infinity();
    double nan = 0.0, infinite = 0.0; ///< how many

    static ChannelFigures read(std::span<const double> numbers)
    {
        ChannelFigures f;
        f.moments = {static_cast<std::int64_t>(numbers[0]), numbers[1], numbers[2]};
        f.lowest = numbers[3];
        f.highest = numbers[4];
        f.nan = numbers[5];
        f.infinite = numbers[6];
        return f;
    }
    void write(std::span<double> numbers) const
    {
        numbers[0] = static_cast<double>(moments.count);
        numbers[1] = moments.mean;
        numbers[2] = moments.deviations;
        numbers[3] = lowest;
        numbers[4] = highest;
        numbers[5] = nan;
        numbers[6] = infinite;
    }
    void add(float value)
    {
        if (std::isnan(value)) {
            nan += 1.0;
        } else if (std::isinf(value)) {
            infinite += 1.0;
        } else {
            moments.add(value);
            lowest = std::min(lowest, static_cast<double>(value));
            highest = std::max(highest, static_cast<double>(value));
        }
    }
    void merge(const ChannelFigures& other)
    {
        moments.merge(other.moments);
        lowest = std::min(lowest, other.lowest);
        highest = std::max(highest, other.highest);
        nan += other.nan;
        infinite += other.infinite;
    }
};

/// measure.channels: figures of every channel of one image.
class MeasureChannels final : public Node
{
public:
    struct Params {
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("measure.channels")
            .summary("Smallest and largest value, mean and spread of every channel of an image.")
            .doc(
                "One row for each channel: `channel`, `minimum`, `maximum`, `mean` and `deviation` "
                "(standard deviation over the pixels, divided by their number) of its finite "
                "values, and how many are `finite`, `nan` and `infinite`. A channel without a "
                "finite value has no minimum, maximum, mean and deviation (null in JSON). The "
                "mean of a variance is the noise of a frame in one number.")
            .accuracy("Sums in double; within 1e-12 (relative) of two passes over the image.")
            .example("rayloom: 1\n"
                     "name: channels-example\n"
                     "inputs:\n"
                     "  image: {doc: any image}\n"
                     "nodes:\n"
                     "  figures: {op: measure.channels, image: image}\n"
                     "outputs:\n"
                     "  figures: figures\n");
        d.input("image", "any image; its data window is measured");
        d.output("figures", "a row for each channel").table();
    }

    explicit MeasureChannels(const Params&) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& image = context.input("image");
        m_channels = image.channels;
        context.reduce_needs("image");
        context.reduce(image.data, m_channels.size() * ChannelFigures::size);
    }

    void compute(const TileContext&) const override {}

    void reduce(const TileContext& row, std::span<double> sums) const override
    {
        const ConstImageView image = row.input("image");
        const Region& region = row.region();
        for (std::size_t c = 0; c < m_channels.size(); ++c) {
            ChannelFigures figures;
            for (int y = region.y0; y < region.y1; ++y)
                for (int x = region.x0; x < region.x1; ++x)
                    figures.add(image.at(static_cast<int>(c), x, y));
            figures.write(sums.subspan(c * ChannelFigures::size, ChannelFigures::size));
        }
    }

    void combine(std::span<double> into, std::span<const double> other) const override
    {
        for (std::size_t i = 0; i < into.size(); i += ChannelFigures::size) {
            ChannelFigures figures = ChannelFigures::read(into.subspan(i));
            figures.merge(ChannelFigures::read(other.subspan(i)));
            figures.write(into.subspan(i));
        }
    }

    std::map<std::string, Table, std::less<>> finish(std::span<const double> totals,
                                                     std::span<const TileContext::Input>) override
    {
        constexpr double none = std::numeric_limits<double>::quiet_NaN();
        Table table;
        table.columns = {"channel",   "minimum", "maximum", "mean",
                         "deviation", "finite",  "nan",     "infinite"};
        for (std::size_t c = 0; c < m_channels.size(); ++c) {
            const auto f = ChannelFigures::read(totals.subspan(c * ChannelFigures::size));
            const auto n = static_cast<double>(f.moments.count);
            const bool any = f.moments.count > 0;
            table.rows.push_back({m_channels[c], any ? f.lowest : none, any ? f.highest : none,
                                  any ? f.moments.mean : none,
                                  any ? std::sqrt(f.moments.deviations / n) : none, n, f.nan,
                                  f.infinite});
        }
        return {{"figures", table}};
    }

private:
    std::vector<std::string> m_channels;
};

RAYLOOM_NODE(MeasureChannels);

} // namespace
} // namespace rayloom

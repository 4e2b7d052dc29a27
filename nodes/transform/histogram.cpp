// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/registry.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string>

namespace rayloom
{

namespace
{

/// x^(1/γ) / max for x ≥ 0, from two tables: one for the exponent of x, one for its mantissa,
/// interpolated. A power for every sample would cost more than the rest of the filter.
class ToneCurve
{
public:
    ToneCurve(double gamma, double max)
    {
        for (int e = 0; e < 256; ++e)
            m_exponent[static_cast<std::size_t>(e)] =
                static_cast<float>(std::pow(2.0, (e - 127) / gamma) / max);
        for (std::size_t i = 0; i <= steps; ++i)
            m_mantissa[i] =
                static_cast<float>(std::pow(1.0 + static_cast<double>(i) / steps, 1.0 / gamma));
        m_gamma = gamma;
        m_max = max;
    }

    float operator()(float x) const
    {
        if (!(x > 0.0f)) return 0.0f;
        const auto bits = std::bit_cast<std::uint32_t>(x);
        const std::uint32_t exponent = bits >> 23;
        if (exponent == 0) // subnormal
            return static_cast<float>(std::pow(static_cast<double>(x), 1.0 / m_gamma) / m_max);
        constexpr int rest_bits = 23 - 10;
        const std::size_t i = (bits & 0x7fffff) >> rest_bits;
        const float rest = static_cast<float>(bits & ((1u << rest_bits) - 1)) /
                           static_cast<float>(1u << rest_bits);
        return m_exponent[exponent] * (m_mantissa[i] + rest * (m_mantissa[i + 1] - m_mantissa[i]));
    }

private:
    static constexpr std::size_t steps = 1024;
    std::array<float, 256> m_exponent;
    std::array<float, steps + 1> m_mantissa;
    double m_gamma, m_max;
};

} // namespace

/// Histograms of each pixel's samples.
class Histogram final : public Node
{
public:
    struct Params {
        int bins = 20;
        float gamma = 2.2f;
        float max = 2.5f;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.histogram")
            .summary("Count each pixel's samples by colour: a ray histogram.")
            .doc("Every sample (one image of a stack, or one sample of a deep pixel) is counted in "
                 "each colour channel apart. With v = max(x, 0)^(1/gamma) / max, capped at 2, and "
                 "f = v·(bins − 2), a sample below v = 1 is split linearly between bins ⌊f⌋ and "
                 "⌊f⌋ + 1; a brighter one between the last two, v − 1 to the last, so that no "
                 "brightness is lost to saturation at once. Channels are Bin_0000, Bin_0001, …: "
                 "the bins of R, of G, of B, then the number of samples.\n\n"
                 "A NaN is counted as black (threshold.sanitize repairs and reports it).")
            .source("004_ae1655312894f2a2.txt, section 4")
            .accuracy("A sample's split differs from the exact one by at most 1e-5.")
            .example("rayloom: 1\n"
                     "name: histogram-example\n"
                     "doc: Ray histogram of renders that differ in their random seed.\n"
                     "inputs:\n"
                     "  stack: {doc: renders of one frame, kind: list, channels: RGB}\n"
                     "nodes:\n"
                     "  histogram: {op: transform.histogram, stack: stack}\n"
                     "outputs:\n"
                     "  image: histogram\n");
        d.input("stack", "renders of one frame that differ in their seed").list().optional();
        d.input("deep", "deep image with one sample for every light path").deep().optional();
        d.output("histogram", "colour channels × bins, then the sample count");
        d.param("bins", &Params::bins, "bins of each colour channel").range(3, 1000);
        d.param("gamma", &Params::gamma, "exponent that spreads dark samples over more bins")
            .range(0.1, 10);
        d.param("max", &Params::max,
                "tone-mapped value of the last but one bin: radiance max^gamma and beyond "
                "saturates")
            .range(1e-3, 1e3);
    }

    explicit Histogram(const Params& p) : m(p), m_curve(p.gamma, p.max) {}

    void plan(PlanContext& context) override
    {
        if (context.has("stack") == context.has("deep"))
            throw NodeError("connect either 'stack' or 'deep'");
        const char* port = context.has("stack") ? "stack" : "deep";
        if (context.count(port) == 0) throw NodeError("input 'stack' is an empty list");
        m_colour.clear();
        for (std::size_t i = 0; i < context.count(port); ++i) {
            m_colour.push_back(context.input(port, i).colour());
            if (m_colour[i].size() != m_colour[0].size())
                throw NodeError("image " + std::to_string(i) + " of the stack has " +
                                std::to_string(m_colour[i].size()) +
                                " colour channels, image 0 has " +
                                std::to_string(m_colour[0].size()));
            context.require_same_window(port, port, 0, i);
        }
        if (m_colour[0].empty())
            throw NodeError("input '" + std::string(port) + "' has no colour channel");
        std::vector<std::string> names;
        for (std::size_t i = 0; i <= m_colour[0].size() * static_cast<std::size_t>(m.bins); ++i) {
            std::array<char, 24> name{};
            std::snprintf(name.data(), name.size(), "Bin_%04zu", i);
            names.emplace_back(name.data());
        }
        context.output("histogram", context.input(port).with_channels(std::move(names)));
    }

    void compute(const TileContext& context) const override
    {
        const ImageView out = context.output("histogram");
        const Region& region = context.region();
        for (int y = region.y0; y < region.y1; ++y) {
            context.check_cancelled();
            for (int c = 0; c < out.channels(); ++c)
                std::fill_n(out.row(c, y), region.width(), 0.0f);
            if (context.has("deep")) {
                count_deep(context.deep("deep"), y, out);
            } else {
                for (std::size_t i = 0; i < m_colour.size(); ++i)
                    count_image(context.input("stack", i), m_colour[i], y, out);
            }
        }
    }

private:
    /// Counts sample `x` in the bins of one channel; `bin` points at the pixel in the first bin.
    void add(float x, float* bin, std::ptrdiff_t stride) const
    {
        const float v = std::min(m_curve(x), 2.0f);
        const float f = v * static_cast<float>(m.bins - 2);
        if (v < 1.0f) {
            const int low = std::min(static_cast<int>(f), m.bins - 3);
            const float high = f - static_cast<float>(low);
            bin[low * stride] += 1.0f - high;
            bin[(low + 1) * stride] += high;
        } else {
            bin[(m.bins - 2) * stride] += 2.0f - v;
            bin[(m.bins - 1) * stride] += v - 1.0f;
        }
    }

    void count_image(ConstImageView image, const std::vector<int>& colour, int y,
                     ImageView out) const
    {
        const Region& region = out.region();
        const std::ptrdiff_t stride = out.channel_stride();
        for (std::size_t c = 0; c < colour.size(); ++c) {
            const float* sample = image.ptr(colour[c], region.x0, y);
            float* bin = out.row(static_cast<int>(c) * m.bins, y);
            for (int x = 0; x < region.width(); ++x) add(sample[x], bin + x, stride);
        }
        float* count = out.row(out.channels() - 1, y);
        for (int x = 0; x < region.width(); ++x) count[x] += 1.0f;
    }

    void count_deep(const DeepView& deep, int y, ImageView out) const
    {
        const Region& region = out.region();
        const std::ptrdiff_t stride = out.channel_stride();
        const DeepRow& row = deep.row(y);
        for (int x = region.x0; x < region.x1; ++x) {
            for (std::size_t c = 0; c < m_colour[0].size(); ++c) {
                const auto samples = row.pixel(m_colour[0][c], x - deep.region.x0);
                float* bin = out.ptr(static_cast<int>(c) * m.bins, x, y);
                for (const float sample : samples) add(sample, bin, stride);
                out.at(out.channels() - 1, x, y) = static_cast<float>(samples.size());
            }
        }
    }

    Params m;
    ToneCurve m_curve;
    std::vector<std::vector<int>> m_colour; ///< per image of the stack
};

RAYLOOM_NODE(Histogram);

} // namespace rayloom

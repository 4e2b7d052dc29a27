// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/nlm_kernel.h"
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"
#include "rayloom/image/border.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

namespace rayloom
{
namespace
{

/// Larger regions are cut into blocks of this size, whose planes stay in the second-level cache.
constexpr int block_width = 256, block_height = 128;
/// Keeps the range variance of noise-free pixels above zero.
constexpr float least_range = 1e-30f;

/// Copies one channel where `from` has pixels; the rest of `to` gets `outside`.
void fill_plane(const ConstImageView& from, int channel, const ImageView& to, int to_channel,
                float outside)
{
    const Region covered = from.region().intersect(to.region());
    for (int y = to.region().y0; y < to.region().y1; ++y) {
        float* row = to.row(to_channel, y);
        if (covered.empty() || y < covered.y0 || y >= covered.y1) {
            std::fill_n(row, to.region().width(), outside);
            continue;
        }
        float* first = row + (covered.x0 - to.region().x0);
        std::fill(row, first, outside);
        std::copy_n(from.ptr(channel, covered.x0, y), covered.width(), first);
        std::fill(first + covered.width(), row + to.region().width(), outside);
    }
}

/// Copies one channel times `scale`, continued beyond the window by reflection. Pixels that even
/// then are not in `from` are too far out to be part of any patch; they get the nearest value.
void fill_mirrored(const ConstImageView& from, int channel, const Region& window, float scale,
                   const ImageView& to, int to_channel)
{
    const Region& have = from.region();
    std::vector<int> columns;
    for (int x = to.region().x0; x < to.region().x1; ++x)
        columns.push_back(std::clamp(border_index(x, window.x0, window.x1, Border::mirror), have.x0,
                                     have.x1 - 1) -
                          have.x0);
    for (int y = to.region().y0; y < to.region().y1; ++y) {
        const int v =
            std::clamp(border_index(y, window.y0, window.y1, Border::mirror), have.y0, have.y1 - 1);
        const float* source = from.row(channel, v);
        float* row = to.row(to_channel, y);
        for (std::size_t i = 0; i < columns.size(); ++i) row[i] = source[columns[i]] * scale;
    }
}

class NonLocalMeans final : public Node
{
public:
    struct Params {
        int window = 31;
        int patch = 5;
        int patch_frames = 1;
        float sigma_s = 0.0f;
        float range = 1.0f;
        std::string gate = "two-sample";
        std::string clamp = "none";
    };

    static void describe(Declaration<Params>& d);
    explicit NonLocalMeans(const Params& p) : m(p) {}
    void plan(PlanContext& context) override;
    void compute(const TileContext& context) const override;

private:
    struct Ports {
        std::vector<int> guide, guide_variance, tested, low, high, variance;
    };

    void plan_list(PlanContext& context, const char* port, std::vector<int> Ports::*channels);
    void compute_block(const TileContext& context, const Region& region) const;

    Params m;
    NlmSettings m_settings;
    Region m_window;
    std::size_t m_frames = 1, m_centre = 0;
    Ports m_channels;
    std::vector<int> m_colour; ///< colour channels of `image`, which the gate looks at
    int m_image_channels = 0;
    bool m_has_variance = false;
};

void NonLocalMeans::describe(Declaration<Params>& d)
{
    d.name("fuse.nlm")
        .summary("Non-local means: averages pixels whose patches agree in a guide image.")
        .doc(
            "D(p) = Σ w(p,q)·N(q) / Σ w(p,q) over a window, with w = exp(−d/(2σ_r²) − "
            "|q−p|²/(2σ_s²)) where the gate accepts q. d is the Gaussian-weighted mean squared "
            "difference of the guide's patches, averaged over its channels; σ_r² = range² times "
            "the smaller guide variance of both pixels. Taking the smaller one makes weights "
            "symmetric, which keeps the brightness of the image: with a variance of each pixel's "
            "own, bright noisy pixels take from dark ones and give nothing back.\n\n"
            "The gate compares means pixel by pixel in each colour channel. `one-sample`: x(q) "
            "lies "
            "in [low(p), high(p)], as printed in the paper; the result then lies in that interval "
            "too, which is the theorem. With few, skewed samples it loses light: a dark pixel's "
            "interval shuts out its brighter twins. `two-sample`: (x(p)−x(q))² ≤ h(p)² + h(q)², "
            "h = (high−low)/2, symmetric. `clamp: interval` brings any result into [low, high].\n\n"
            "`image` may be a list, the frames of an animation around the current one; all other "
            "lists then have one element a frame. The current frame is the one after those of "
            "`earlier` (whose pixels are not read), or the first. A frame counts as one pixel of "
            "distance. Patches at the border see the mirrored guide; windows are clipped.\n\n"
            "Without `guide` the image guides itself. Without `guide_variance`, σ_r = range, in "
            "units of the guide. Alpha is averaged like colour, so colour is expected "
            "premultiplied; neither gate nor guide looks at it.")
        .source("000_092f36e585912bb0.txt, eq. (1), (2), section 3.2 to 3.5; two-sample gate: "
                "MATH.md, section 2; Buades et al. 2005")
        .version(2)
        .accuracy("Single precision, the same bits on every SIMD target. Against the double oracle "
                  "below 2e-5 relative to the largest value in the window.")
        .example("rayloom: 1\n"
                 "name: nlm-example\n"
                 "inputs:\n"
                 "  image: {doc: noisy radiance, channels: RGB}\n"
                 "  albedo: {doc: noise-free guide, channels: RGB}\n"
                 "nodes:\n"
                 "  result: {op: fuse.nlm, image: image, guide: albedo, range: 0.05, gate: none}\n"
                 "outputs:\n"
                 "  image: result.image\n");
    d.input("image", "what is averaged; linear radiance, premultiplied; one frame or several")
        .list();
    d.input("guide", "where patches are compared; any channels but alpha").list().optional();
    d.input("guide_variance", "variance of the guide's pixels; its channels are averaged")
        .list()
        .optional();
    d.input("low", "lower end of each pixel's interval, one channel per colour").list().optional();
    d.input("high", "upper end of each pixel's interval").list().optional();
    d.input("tested", "values the gate compares; the image itself when absent").list().optional();
    d.input("variance", "variance of the image's pixels, for the variance of the result")
        .list()
        .optional();
    d.input("earlier", "frames before the current one; only their number is looked at")
        .list()
        .optional();
    d.output("image", "filtered image");
    d.output("variance", "Σ w²·V / (Σ w)²: variance of the result for fixed weights; needs the "
                         "input `variance`")
        .optional();
    d.param("window", &Params::window, "Side of the square window, odd.")
        .range(1, 201)
        .unit("px")
        .source("section 4: 31; first step 7");
    d.param("patch", &Params::patch, "Side of the square patch, odd.")
        .range(1, 31)
        .unit("px")
        .source("section 4: 5");
    d.param("patch_frames", &Params::patch_frames,
            "Frames a patch spans, odd; the last frame repeats at the ends.")
        .range(1, 31);
    d.param("sigma_s", &Params::sigma_s,
            "Standard deviation of the spatial Gaussian; 0: a third of the window.")
        .range(0, 1e6)
        .unit("px")
        .source("section 4");
    d.param("range", &Params::range, "σ_r as a multiple of the guide's standard deviation.")
        .range(1e-6, 1e6)
        .source("section 4, \"linearly proportional\"; value by measurement");
    d.param("gate", &Params::gate, "Which pixels of the window are averaged.")
        .choices({"one-sample", "two-sample", "none"})
        .source("eq. (2)");
    d.param("clamp", &Params::clamp, "Whether the result is brought into [low, high].")
        .choices({"none", "interval"})
        .source("theorem 3.1");
}

/// Same number of frames and same windows as `image`; keeps the colour channels.
void NonLocalMeans::plan_list(PlanContext& context, const char* port,
                              std::vector<int> Ports::*channels)
{
    if (!context.has(port)) return;
    if (context.count(port) != m_frames)
        throw NodeError(std::string("'image' has ") + std::to_string(m_frames) + " frames and '" +
                        port + "' " + std::to_string(context.count(port)) +
                        "; every list must have one element a frame");
    for (std::size_t i = 0; i < m_frames; ++i) {
        context.require_same_window("image", port, i, i);
        const std::vector<int> colour = require_colours(context, port, i);
        if (i > 0 && colour != m_channels.*channels)
            throw NodeError(std::string("the frames of '") + port + "' have different channels");
        m_channels.*channels = colour;
    }
}

void NonLocalMeans::plan(PlanContext& context)
{
    for (const auto& [name, value] : {std::pair{"window", m.window}, std::pair{"patch", m.patch},
                                      std::pair{"patch_frames", m.patch_frames}})
        if (value % 2 == 0)
            throw NodeError(std::string(name) + " is " + std::to_string(value) +
                            "; it must be odd, so that there is a middle (" +
                            std::to_string(value - 1) + " or " + std::to_string(value + 1) + ")");
    m_settings.window_radius = m.window / 2;
    m_settings.patch_radius = m.patch / 2;
    m_settings.sigma_s = m.sigma_s > 0.0f ? m.sigma_s : static_cast<float>(m.window) / 3.0f;
    m_settings.gate = m.gate == "none"         ? NlmGate::none
                      : m.gate == "one-sample" ? NlmGate::one_sample
                                               : NlmGate::two_sample;
    m_frames = context.count("image");
    m_centre = context.has("earlier") ? context.count("earlier") : 0;
    if (m_frames == 0) throw NodeError("'image' has no frame");
    if (m_centre >= m_frames)
        throw NodeError("there are " + std::to_string(m_centre) + " earlier frames and " +
                        std::to_string(m_frames) +
                        " in 'image', which must hold them and the current frame");
    const ImageDesc& current = context.input("image", m_centre);
    m_window = current.data;
    m_image_channels = current.channel_count();
    m_colour = current.colour();
    for (std::size_t i = 0; i < m_frames; ++i) {
        context.require_same_window("image", "image", m_centre, i);
        if (context.input("image", i).channels != current.channels)
            throw NodeError("the frames of 'image' have different channels");
    }
    m_channels = {};
    plan_list(context, "guide", &Ports::guide);
    plan_list(context, "guide_variance", &Ports::guide_variance);
    plan_list(context, "tested", &Ports::tested);
    plan_list(context, "low", &Ports::low);
    plan_list(context, "high", &Ports::high);
    plan_list(context, "variance", &Ports::variance);
    if (!context.has("guide")) m_channels.guide = m_colour;
    if (!context.has("tested")) m_channels.tested = m_colour;
    const bool interval = context.has("low") && context.has("high");
    const bool wants_interval = m_settings.gate != NlmGate::none || m.clamp == "interval";
    if (wants_interval && !interval)
        throw NodeError("gate '" + m.gate + "' and clamp '" + m.clamp +
                        "' need the inputs low and high (from threshold.interval); without sample "
                        "statistics set gate: none and clamp: none");
    if (wants_interval && (m_channels.low.size() != m_channels.tested.size() ||
                           m_channels.high.size() != m_channels.tested.size()))
        throw NodeError("low, high and what the gate compares must have the same number of "
                        "channels; they have " +
                        std::to_string(m_channels.low.size()) + ", " +
                        std::to_string(m_channels.high.size()) + " and " +
                        std::to_string(m_channels.tested.size()));
    if (m.clamp == "interval" && m_channels.low.size() != m_colour.size())
        throw NodeError("clamp: interval needs one channel of low and high per colour of 'image'");
    m_has_variance = context.has("variance");
    if (m_has_variance && m_channels.variance.size() != m_colour.size())
        throw NodeError("'variance' has " + std::to_string(m_channels.variance.size()) +
                        " channels and 'image' " + std::to_string(m_colour.size()) + " colours");

    context.output("image", current);
    context.output("variance", current.with_channels(channel_names(current, m_colour)));
    const Halo pixels = Halo::all(m_settings.window_radius);
    const Halo patches = Halo::all(m_settings.window_radius + m_settings.patch_radius);
    context.needs("image", context.has("guide") ? pixels : patches);
    if (context.has("guide")) context.needs("guide", patches);
    for (const char* port : {"guide_variance", "tested", "low", "high", "variance"})
        if (context.has(port)) context.needs(port, pixels);
    if (context.has("earlier")) context.needs("earlier", [](const Need&) { return Region{}; });
    if (m.window == 1 && m.clamp == "none") context.pass_through("image", "image", 0, m_centre);

    const Region block{0, 0, block_width, block_height};
    const Region planes = nlm_plane_region(block, m_settings);
    const auto channels =
        static_cast<int>(m_channels.guide.size()) * m.patch_frames + 1 + m_image_channels +
        static_cast<int>(m_channels.tested.size() * 3 + m_channels.variance.size());
    context.scratch(ImageBuffer::bytes_for(planes, channels) * m_frames +
                    ImageBuffer::bytes_for(nlm_sums_region(block), 2 * m_image_channels + 1) +
                    nlm_scratch_bytes(block, m_settings));
}

void NonLocalMeans::compute(const TileContext& context) const
{
    const Region& region = context.region();
    for (int y = region.y0; y < region.y1; y += block_height)
        for (int x = region.x0; x < region.x1; x += block_width) {
            context.check_cancelled();
            compute_block(context, {x, y, std::min(x + block_width, region.x1),
                                    std::min(y + block_height, region.y1)});
        }
}

void NonLocalMeans::compute_block(const TileContext& context, const Region& region) const
{
    const Region planes = nlm_plane_region(region, m_settings);
    const bool interval = m_settings.gate != NlmGate::none;
    const auto guides = static_cast<int>(m_channels.guide.size());
    const auto tested = interval ? static_cast<int>(m_channels.tested.size()) : 0;
    const auto variances = m_has_variance ? static_cast<int>(m_channels.variance.size()) : 0;
    const bool one_sample = m_settings.gate == NlmGate::one_sample;
    // The gate's planes are the image's own where its colours lie side by side.
    const bool own_pixels =
        interval && !context.has("tested") && m_colour.back() - m_colour.front() == tested - 1;
    const std::vector<float> frame_weights = nlm_patch_weights(m.patch_frames / 2);

    std::vector<ImageBuffer> storage;
    std::vector<NlmFrame> frames;
    std::vector<std::size_t> order{m_centre};
    for (std::size_t i = 0; i < m_frames; ++i)
        if (i != m_centre) order.push_back(i);
    storage.reserve(m_frames);
    for (const std::size_t i : order) {
        const int guide_planes = guides * m.patch_frames;
        const int interval_planes = tested * ((own_pixels ? 0 : 1) + (one_sample ? 2 : 1));
        ImageBuffer& buffer = storage.emplace_back(planes, guide_planes + 1 + m_image_channels +
                                                               interval_planes + variances);
        int next = 0;
        const auto take = [&](int count) {
            const ImageView part = buffer.view().channel_range(next, count);
            next += count;
            return count > 0 ? part : ImageView();
        };
        NlmFrame frame;
        frame.distance = std::abs(static_cast<int>(i) - static_cast<int>(m_centre));

        const ImageView guide = take(guide_planes);
        for (int f = 0; f < m.patch_frames; ++f) {
            const auto at = static_cast<std::size_t>(std::clamp(
                static_cast<int>(i) + f - m.patch_frames / 2, 0, static_cast<int>(m_frames) - 1));
            const ConstImageView from = context.input(context.has("guide") ? "guide" : "image", at);
            const float scale =
                std::sqrt(frame_weights[static_cast<std::size_t>(f)] / static_cast<float>(guides));
            for (int c = 0; c < guides; ++c)
                fill_mirrored(from, m_channels.guide[static_cast<std::size_t>(c)], m_window, scale,
                              guide, f * guides + c);
        }
        frame.guide = guide;

        const ImageView inverse = take(1);
        const float factor = 2.0f * m.range * m.range;
        const ConstImageView image = context.input("image", i);
        for (int y = planes.y0; y < planes.y1; ++y) {
            float* row = inverse.row(0, y);
            std::fill_n(row, planes.width(), std::numeric_limits<float>::infinity());
            const ConstImageView from =
                context.has("guide_variance") ? context.input("guide_variance", i) : image;
            const Region covered = from.region().intersect(planes).intersect(m_window);
            if (y < covered.y0 || y >= covered.y1) continue;
            for (int x = covered.x0; x < covered.x1; ++x) {
                float v = 1.0f;
                if (context.has("guide_variance")) {
                    v = 0.0f;
                    for (const int c : m_channels.guide_variance) v += from.at(c, x, y);
                    v /= static_cast<float>(m_channels.guide_variance.size());
                }
                row[x - planes.x0] = nlm_log2_e / std::max(factor * v, least_range);
            }
        }
        frame.inverse = inverse;

        const ImageView pixels = take(m_image_channels);
        for (int c = 0; c < m_image_channels; ++c) fill_plane(image, c, pixels, c, 0.0f);
        frame.image = pixels;

        if (interval) {
            const ConstImageView low = context.input("low", i), high = context.input("high", i);
            const ImageView x_plane =
                own_pixels ? pixels.channel_range(m_colour.front(), tested) : take(tested);
            const ImageView a_plane = take(tested), b_plane = take(one_sample ? tested : 0);
            for (int c = 0; c < tested; ++c) {
                const auto at = static_cast<std::size_t>(c);
                if (!own_pixels)
                    fill_plane(context.has("tested") ? context.input("tested", i) : image,
                               m_channels.tested[at], x_plane, c, 0.0f);
                fill_plane(low, m_channels.low[at], a_plane, c, 0.0f);
                if (one_sample) {
                    fill_plane(high, m_channels.high[at], b_plane, c, 0.0f);
                    continue;
                }
                const Region covered = low.region().intersect(planes);
                for (int y = covered.y0; y < covered.y1; ++y)
                    for (int x = covered.x0; x < covered.x1; ++x) {
                        const float h = 0.5f * (high.at(m_channels.high[at], x, y) -
                                                low.at(m_channels.low[at], x, y));
                        a_plane.at(c, x, y) = h * h;
                    }
            }
            frame.tested = x_plane;
            if (one_sample) {
                frame.low = a_plane;
                frame.high = b_plane;
            } else {
                frame.spread = a_plane;
            }
        }
        if (variances > 0) {
            const ImageView plane = take(variances);
            for (int c = 0; c < variances; ++c)
                fill_plane(context.input("variance", i),
                           m_channels.variance[static_cast<std::size_t>(c)], plane, c, 0.0f);
            frame.variance = plane;
        }
        frames.push_back(frame);
    }

    ImageBuffer sums(nlm_sums_region(region), m_image_channels + 1 + variances);
    nlm_sums({region, m_window, m_settings, frames, sums.view()});

    const ConstImageView result = sums.view();
    // A result of the one-sample gate lies in the interval but for rounding.
    const bool rounding_only = one_sample && !context.has("tested");
    for (int y = region.y0; y < region.y1; ++y) {
        const float* total = result.ptr(m_image_channels, region.x0, y);
        if (context.wants("image")) {
            const ImageView out = context.output("image");
            for (int c = 0; c < m_image_channels; ++c) {
                const float* sum = result.ptr(c, region.x0, y);
                float* to = out.ptr(c, region.x0, y);
                for (int i = 0; i < region.width(); ++i) to[i] = sum[i] / total[i];
            }
            if (m.clamp == "interval" || rounding_only)
                for (std::size_t c = 0; c < m_colour.size(); ++c) {
                    const float* low =
                        context.input("low", m_centre).ptr(m_channels.low[c], region.x0, y);
                    const float* high =
                        context.input("high", m_centre).ptr(m_channels.high[c], region.x0, y);
                    float* to = out.ptr(m_colour[c], region.x0, y);
                    for (int i = 0; i < region.width(); ++i)
                        to[i] = std::max(low[i], std::min(to[i], high[i]));
                }
        }
        if (context.wants("variance") && m_has_variance)
            for (int c = 0; c < variances; ++c) {
                const float* sum = result.ptr(m_image_channels + 1 + c, region.x0, y);
                float* to = context.output("variance").ptr(c, region.x0, y);
                for (int i = 0; i < region.width(); ++i) to[i] = sum[i] / (total[i] * total[i]);
            }
    }
}

RAYLOOM_NODE(NonLocalMeans);

} // namespace
} // namespace rayloom

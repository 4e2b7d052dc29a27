// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/registry.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace rayloom
{

namespace
{

/// Where one object ends and another begins.
class Boundary final : public Node
{
public:
    struct Params {
        float depth_step = 0.05f;
        float normal_angle = 60.0f;
        int radius = 0;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("threshold.boundary")
            .summary("Marks the pixels beside a boundary of a visible object.")
            .doc("A pixel is marked when one of its four neighbours is of another part (the id "
                 "with the most coverage differs), when their normals differ by more than "
                 "`normal_angle`, or when depth leaps: by more than `depth_step` of itself and "
                 "more than twice the step on either side of the pair, so that a surface seen at "
                 "a grazing angle is no boundary. Pixels without a normal (zero, NaN) or without "
                 "depth (not finite, at least 1e9, not above 0) differ from those that have one, "
                 "and not from one another. Without any input nothing is marked.")
            .source("003_fb3ee135f07a6099.txt, section 4.4, weight w_b and figure 4")
            .accuracy("Exact decisions in float.")
            .example("rayloom: 1\n"
                     "name: boundary-example\n"
                     "doc: Boundaries of the objects in a render.\n"
                     "inputs:\n"
                     "  render: {doc: gives the size, channels: RGB}\n"
                     "  depth: {doc: distance from the camera, channels: Z}\n"
                     "  normal: {doc: surface normal, channels: \"X,Y,Z\"}\n"
                     "nodes:\n"
                     "  edges: {op: threshold.boundary, image: render, depth: depth, normal: "
                     "normal}\n"
                     "outputs:\n"
                     "  boundary: edges\n");
        d.input("image", "gives windows; its pixels are not read");
        d.input("depth", "distance from the camera; the first channel counts").optional();
        d.input("normal", "surface normal, 3 channels").optional();
        d.input("parts", "pairs of id and coverage (transform.parts)").optional();
        d.output("boundary", "1 on boundaries, else 0");
        d.param("depth_step", &Params::depth_step, "least leap of depth, relative to the nearer")
            .min(0);
        d.param("normal_angle", &Params::normal_angle, "least angle between normals")
            .range(0, 180)
            .unit("degrees")
            .source("003_fb3ee135f07a6099.txt, section 4.4: n·n′ = 1/2");
        d.param("radius", &Params::radius, "pixels marked around a boundary pixel, as a square")
            .range(0, 16)
            .unit("px");
    }

    explicit Boundary(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& image = context.input("image");
        m_data = image.data;
        context.needs("image", [](const Need&) { return Region{}; });
        for (const char* port : {"depth", "normal", "parts"})
            if (context.has(port)) {
                context.require_same_window("image", port);
                context.needs(port, Halo::all(m.radius + 2));
            }
        if (context.has("normal") && context.input("normal").channel_count() < 3)
            throw NodeError("input 'normal' has " +
                            std::to_string(context.input("normal").channel_count()) +
                            " channels; a normal has three");
        if (context.has("parts") && context.input("parts").channel_count() < 2)
            throw NodeError("input 'parts' has one channel; pairs of id and coverage are needed");
        context.output("boundary", image.with_channels({"boundary"}));
        if (!context.has("depth") && !context.has("normal") && !context.has("parts"))
            context.constant("boundary", 0.0f);
        m_cosine = std::cos(m.normal_angle * 0.01745329252f);
    }

    void compute(const TileContext& context) const override
    {
        const Region& region = context.region();
        const Region wide = region.grown(Halo::all(m.radius)).intersect(m_data);
        const Guides guides = guides_of(context);
        ImageBuffer marks(wide, 1);
        marks.fill(0.0f);
        const auto mark = [&](int x, int y) {
            if (wide.contains(x, y)) marks.view().at(0, x, y) = 1.0f;
        };
        // Each pair of neighbours once, those that reach in from the left and from above too.
        for (int y = wide.y0 - 1; y < wide.y1; ++y)
            for (int x = wide.x0 - 1; x < wide.x1; ++x)
                for (const auto& [dx, dy] : {std::pair{1, 0}, {0, 1}}) {
                    if (dx == 1 ? y < wide.y0 : x < wide.x0) continue;
                    if (!m_data.contains(x, y) || !m_data.contains(x + dx, y + dy)) continue;
                    if (!differ(guides, x, y, dx, dy)) continue;
                    mark(x, y);
                    mark(x + dx, y + dy);
                }
        for (int y = region.y0; y < region.y1; ++y)
            for (int x = region.x0; x < region.x1; ++x) {
                float most = 0.0f;
                for (int v = std::max(wide.y0, y - m.radius);
                     v < std::min(wide.y1, y + m.radius + 1); ++v)
                    for (int u = std::max(wide.x0, x - m.radius);
                         u < std::min(wide.x1, x + m.radius + 1); ++u)
                        most = std::max(most, marks.view().at(0, u, v));
                context.output("boundary").at(0, x, y) = most;
            }
    }

private:
    /// Empty where there is none.
    struct Guides {
        ConstImageView parts, normal, depth;
    };

    static Guides guides_of(const TileContext& context)
    {
        Guides guides;
        if (context.has("parts")) guides.parts = context.input("parts");
        if (context.has("normal")) guides.normal = context.input("normal");
        if (context.has("depth")) guides.depth = context.input("depth");
        return guides;
    }

    bool differ(const Guides& guides, int x, int y, int dx, int dy) const
    {
        if (const ConstImageView& parts = guides.parts; !parts.empty())
            if (main_part(parts, x, y) != main_part(parts, x + dx, y + dy)) return true;
        if (const ConstImageView& n = guides.normal; !n.empty()) {
            float dot = 0.0f, a = 0.0f, b = 0.0f;
            for (int c = 0; c < 3; ++c) {
                const float u = n.at(c, x, y), v = n.at(c, x + dx, y + dy);
                dot += u * v;
                a += u * u;
                b += v * v;
            }
            const bool has_a = std::isfinite(a) && a > 0.0025f,
                       has_b = std::isfinite(b) && b > 0.0025f;
            if (has_a != has_b) return true;
            if (has_a && dot < m_cosine * std::sqrt(a * b)) return true;
        }
        if (const ConstImageView& depth = guides.depth; !depth.empty()) {
            const float a = depth.at(0, x, y), b = depth.at(0, x + dx, y + dy);
            const auto is_depth = [](float z) { return z > 0.0f && z < 1e9f; };
            if (is_depth(a) != is_depth(b)) return true;
            const float leap = std::abs(a - b);
            if (is_depth(a) && leap > m.depth_step * std::min(a, b)) {
                float slope = 0.0f;
                const auto step = [&](int px, int py, float from) {
                    if (!m_data.contains(px, py)) return;
                    const float z = depth.at(0, px, py);
                    if (is_depth(z)) slope = std::max(slope, std::abs(z - from));
                };
                step(x - dx, y - dy, a);
                step(x + 2 * dx, y + 2 * dy, b);
                if (leap > 2.0f * slope) return true;
            }
        }
        return false;
    }

    static float main_part(const ConstImageView& parts, int x, int y)
    {
        float id = 0.0f, most = 0.0f;
        for (int i = 0; i + 1 < parts.channels(); i += 2)
            if (parts.at(i + 1, x, y) > most) {
                most = parts.at(i + 1, x, y);
                id = parts.at(i, x, y);
            }
        return id;
    }

    Params m;
    Region m_data;
    float m_cosine = 0.5f;
};

RAYLOOM_NODE(Boundary);

} // namespace
} // namespace rayloom

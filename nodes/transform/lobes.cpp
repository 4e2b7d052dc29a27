// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/render_roles.h"
#include "rayloom/core/registry.h"

#include <algorithm>

namespace rayloom
{
namespace
{

/// transform.lobes: the passes of a render as partial images and their pivots.
class Lobes final : public Node
{
public:
    struct Params {
        std::string renderer = "auto";
        bool split = false;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.lobes")
            .summary("Turns the passes of a render into partial images, each with its pivot.")
            .doc("A partial image is the light by way of one kind of surface: diffuse, glossy, "
                 "transmission, subsurface. Its radiance is the sum of its direct and indirect "
                 "layers (multiplied by the colour layer where the renderer divided by it, as "
                 "Cycles does), its pivot the colour layer; of diffuse light, without one, the "
                 "albedo. The renderer maps say which layer is which. With `split`, direct and "
                 "indirect light are partial images of their own.\n\n"
                 "A lobe whose layers are absent or black is left out of the lists, so that "
                 "nothing after it costs anything; the report names it. A lobe without a pivot is "
                 "left out too: with everything else (emission, surroundings, volumes, what the "
                 "passes miss) it is in what transform.remainder takes from the beauty.")
            .source("003_fb3ee135f07a6099.txt, section 8")
            .accuracy("One addition and one multiplication in float.")
            .example("rayloom: 1\n"
                     "name: lobes-example\n"
                     "doc: The sum of the partial images of a render.\n"
                     "inputs:\n"
                     "  render: {doc: all layers of a render}\n"
                     "nodes:\n"
                     "  layers: {op: transform.layers, image: render}\n"
                     "  lobes: {op: transform.lobes, render: render, layers: layers}\n"
                     "  sum: {op: fuse.sum, images: lobes.radiance}\n"
                     "outputs:\n"
                     "  image: sum\n");
        d.input("render", "all layers of a render, channels named layer.channel; only names count");
        d.input("layers", "its layers, from transform.layers").list();
        d.output("radiance", "one image for each lobe, R G B").list();
        d.output("pivot", "its pivot, R G B").list();
        d.param("renderer", &Params::renderer,
                "renderer map to use (cycles, arnold, …); auto: the one that knows most layers");
        d.param("split", &Params::split, "direct and indirect light apart");
    }

    explicit Lobes(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& render = context.input("render");
        const RenderRoles roles(render, m.renderer);
        m_lobes = find_lobes(context, {m.renderer, m.split}, roles);
        context.note("names as " + roles.renderer() + " writes them");
        std::vector<ImageDesc> images;
        m_channels.clear();
        for (std::size_t i = 0; i < context.count("layers"); ++i)
            m_channels.push_back(context.input("layers", i).colour());
        for (const Lobe& lobe : m_lobes) {
            for (const int layer : lobe.light) check(lobe, layer);
            check(lobe, lobe.pivot);
            images.push_back(render.with_channels({"R", "G", "B"}));
        }
        context.output_list("radiance", images);
        context.output_list("pivot", images);
        context.needs("render", [](const Need&) { return Region{}; });
        std::vector<Lobe> lobes = m_lobes;
        context.needs("layers", [lobes](const Need& need) {
            const Lobe& lobe = lobes.at(need.output_element);
            const auto layer = static_cast<int>(need.input_element);
            const bool used = layer == lobe.pivot || std::find(lobe.light.begin(), lobe.light.end(),
                                                               layer) != lobe.light.end();
            return used ? need.region : Region{};
        });
    }

    void compute(const TileContext& context) const override
    {
        const Lobe& lobe = m_lobes[context.element()];
        const Region& r = context.region();
        const auto row = [&](int layer, int c, int y) {
            const auto i = static_cast<std::size_t>(layer);
            return context.input("layers", i)
                .ptr(m_channels[i][static_cast<std::size_t>(c)], r.x0, y);
        };
        for (int c = 0; c < 3; ++c)
            for (int y = r.y0; y < r.y1; ++y) {
                const float* pivot = row(lobe.pivot, c, y);
                if (context.wants("pivot"))
                    std::copy_n(pivot, r.width(), context.output("pivot").row(c, y));
                if (!context.wants("radiance")) continue;
                float* to = context.output("radiance").row(c, y);
                std::copy_n(row(lobe.light[0], c, y), r.width(), to);
                for (std::size_t i = 1; i < lobe.light.size(); ++i) {
                    const float* from = row(lobe.light[i], c, y);
                    for (int x = 0; x < r.width(); ++x) to[x] += from[x];
                }
                if (lobe.divided)
                    for (int x = 0; x < r.width(); ++x) to[x] *= pivot[x];
            }
    }

private:
    void check(const Lobe& lobe, int layer) const
    {
        const std::size_t n = m_channels[static_cast<std::size_t>(layer)].size();
        if (n != 3)
            throw NodeError("a layer of lobe '" + lobe.name + "' has " + std::to_string(n) +
                            " colour channels; R, G and B are needed");
    }

    Params m;
    std::vector<Lobe> m_lobes;
    std::vector<std::vector<int>> m_channels; ///< [layer]
};
RAYLOOM_NODE(Lobes);

} // namespace
} // namespace rayloom

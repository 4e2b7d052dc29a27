// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/render_roles.h"
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"

#include <algorithm>
#include <string>

namespace rayloom
{
namespace
{

/// transform.merge_lobes: filtered partial images back in the passes of their render.
class MergeLobes final : public Node
{
public:
    struct Params {
        std::string renderer = "auto";
        bool split = false;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.merge_lobes")
            .summary("Puts filtered partial images and the beauty back into the render's layers.")
            .doc("The reverse of transform.lobes with the same parameters: a light layer becomes "
                 "its filtered radiance, divided by the colour layer where the renderer divides "
                 "(where the colour is 0 the layer stays as it was). A lobe of two layers shares "
                 "its filtered light between them as they shared the noisy one. The beauty's "
                 "colour is replaced, and every other channel is passed on bit for bit; no channel "
                 "is renamed.")
            .source("003_fb3ee135f07a6099.txt, section 8")
            .accuracy("One multiplication and two divisions in float.")
            .example("rayloom: 1\n"
                     "name: merge-lobes-example\n"
                     "doc: Takes a render apart and puts it together again.\n"
                     "inputs:\n"
                     "  render: {doc: all layers of a render}\n"
                     "nodes:\n"
                     "  layers: {op: transform.layers, image: render}\n"
                     "  beauty: {op: transform.pass, image: render, role: beauty}\n"
                     "  lobes: {op: transform.lobes, render: render, layers: layers}\n"
                     "  merged: {op: transform.merge_lobes, render: render, layers: layers, lobes: "
                     "lobes.radiance, beauty: beauty}\n"
                     "outputs:\n"
                     "  image: merged\n");
        d.input("render", "all layers of a render, channels named layer.channel");
        d.input("layers", "its layers, from transform.layers").list();
        d.input("lobes", "filtered radiance of each lobe, as transform.lobes lists them")
            .list()
            .optional();
        d.input("beauty", "the filtered beauty");
        d.output("image", "the render with these layers filtered");
        d.param("renderer", &Params::renderer, "as in transform.lobes");
        d.param("split", &Params::split, "as in transform.lobes");
    }

    explicit MergeLobes(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& render = context.input("render");
        const RenderRoles roles(render, m.renderer);
        m_lobes = find_lobes(context, {m.renderer, m.split}, roles);
        if (m_lobes.size() != context.count("lobes"))
            throw NodeError("the render has " + std::to_string(m_lobes.size()) +
                            " lobes, 'lobes' holds " + std::to_string(context.count("lobes")) +
                            "; give both nodes the same 'split' and 'renderer'");
        context.require_same_window("render", "beauty");
        m_beauty = context.input("beauty").colour();
        m_layers.clear();
        for (const LayerChannels& layer : roles.layers()) {
            std::vector<int> colours;
            for (const int c : render.with_channels(layer.names).colour())
                colours.push_back(layer.indices[static_cast<std::size_t>(c)]);
            m_layers.push_back(std::move(colours));
        }
        const int beauty = roles.find("beauty");
        m_target = beauty >= 0 ? m_layers[static_cast<std::size_t>(beauty)] : std::vector<int>();
        if (m_target.size() != m_beauty.size())
            throw NodeError("the render has no beauty layer with as many colour channels as "
                            "input 'beauty'");
        std::vector<int> written = m_target;
        for (std::size_t i = 0; i < m_lobes.size(); ++i) {
            if (context.input("lobes", i).colour().size() != 3)
                throw NodeError("lobe " + std::to_string(i) + " needs three colour channels");
            for (const int layer : m_lobes[i].light)
                written.insert(written.end(), m_layers[static_cast<std::size_t>(layer)].begin(),
                               m_layers[static_cast<std::size_t>(layer)].end());
        }
        context.output("image", render);
        m_passed.plan(context, "render", written);
        context.needs("layers", [](const Need&) { return Region{}; });
    }

    void compute(const TileContext& context) const override
    {
        const Region& r = context.region();
        const ConstImageView render = context.input("render");
        const ImageView out = context.output("image");
        const auto row = [&](int layer, std::size_t c, int y) {
            return render.ptr(m_layers[static_cast<std::size_t>(layer)][c], r.x0, y);
        };
        m_passed.copy(render, out);
        for (int y = r.y0; y < r.y1; ++y) {
            for (std::size_t c = 0; c < m_target.size(); ++c)
                std::copy_n(context.input("beauty").ptr(m_beauty[c], r.x0, y), r.width(),
                            out.row(m_target[c], y));
            for (std::size_t i = 0; i < m_lobes.size(); ++i) {
                const Lobe& lobe = m_lobes[i];
                const ConstImageView filtered = context.input("lobes", i);
                for (std::size_t c = 0; c < 3; ++c) {
                    const float* f = filtered.ptr(static_cast<int>(c), r.x0, y);
                    const float* pivot = row(lobe.pivot, c, y);
                    for (int x = 0; x < r.width(); ++x) {
                        const bool known = !lobe.divided || pivot[x] > 0.0f;
                        const float light = lobe.divided && known ? f[x] / pivot[x] : f[x];
                        float sum = 0.0f;
                        for (const int layer : lobe.light) sum += row(layer, c, y)[x];
                        for (std::size_t k = 0; k < lobe.light.size(); ++k) {
                            const float was = row(lobe.light[k], c, y)[x];
                            const float share = sum > 0.0f ? was / sum : k == 0 ? 1.0f : 0.0f;
                            const int to = m_layers[static_cast<std::size_t>(lobe.light[k])][c];
                            out.row(to, y)[x] = !known                   ? was
                                                : lobe.light.size() == 1 ? light
                                                                         : light * share;
                        }
                    }
                }
            }
        }
    }

private:
    Params m;
    std::vector<Lobe> m_lobes;
    std::vector<std::vector<int>> m_layers; ///< [layer]: colour channels in the render
    std::vector<int> m_beauty, m_target;
    PassedChannels m_passed;
};
RAYLOOM_NODE(MergeLobes);

} // namespace
} // namespace rayloom

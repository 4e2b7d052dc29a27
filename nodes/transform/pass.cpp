// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/render_roles.h"
#include "rayloom/core/registry.h"
#include "rayloom/core/text.h"

#include <algorithm>

namespace rayloom
{
namespace
{

/// transform.pass: the layer of a render that plays a role.
class Pass final : public Node
{
public:
    struct Params {
        std::string role;
        std::string renderer = "auto";
        bool required = true;
        std::vector<std::string> blank = {"R", "G", "B"};
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.pass")
            .summary("Takes the layer that plays a role out of an image that carries many.")
            .doc("The renderer maps say which layer is the beauty, the normal, the depth. What is "
                 "taken is passed on bit for bit. Where no layer plays the role and it is not "
                 "`required`, the result is 0 everywhere and the report says so.")
            .accuracy("Exact.")
            .example("rayloom: 1\n"
                     "name: pass-example\n"
                     "doc: The beauty of a render.\n"
                     "inputs:\n"
                     "  render: {doc: all layers of a render}\n"
                     "nodes:\n"
                     "  beauty: {op: transform.pass, image: render, role: beauty}\n"
                     "outputs:\n"
                     "  image: beauty\n");
        d.input("image", "all layers of a render, channels named layer.channel");
        d.output("image", "the channels of the layer, named without it");
        d.param("role", &Params::role, "role as in graphs/renderers: beauty, normal, depth, …")
            .required();
        d.param("renderer", &Params::renderer,
                "renderer map to use; auto: the one that knows most layers");
        d.param("required", &Params::required, "whether it is an error when no layer plays it");
        d.param("blank", &Params::blank, "channels of the result when no layer plays it");
    }

    explicit Pass(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        std::vector<std::string> known;
        for (const auto& [role, doc] : renderer_roles()) known.push_back(role);
        if (std::find(known.begin(), known.end(), m.role) == known.end())
            throw NodeError("there is no role '" + m.role + "'" + suggestion(m.role, known));
        const ImageDesc& image = context.input("image");
        const RenderRoles roles(image, m.renderer);
        const int found = roles.find(m.role);
        m_picks.clear();
        if (found < 0) {
            std::vector<std::string> names;
            for (const LayerChannels& layer : roles.layers()) names.push_back(layer.layer);
            if (m.required)
                throw NodeError("no layer is the " + m.role + " of a " + roles.renderer() +
                                " render; there is: " + join_names(names));
            context.note("no " + m.role + " among the layers");
            context.output("image", image.with_channels(m.blank));
            context.constant("image", 0.0f);
            return;
        }
        const LayerChannels& layer = roles.layers()[static_cast<std::size_t>(found)];
        m_picks = parse_channel_picks(layer.names, layer.names, layer.indices);
        context.output("image", image.with_channels(pick_names(m_picks)));
        declare_picks(context, "image", 0, m_picks);
    }

    void compute(const TileContext& context) const override
    {
        const ImageView out = context.output("image");
        if (!m_picks.empty()) return copy_picks(context.input("image"), m_picks, out);
        for (int y = out.region().y0; y < out.region().y1; ++y)
            for (int c = 0; c < out.channels(); ++c)
                std::fill_n(out.row(c, y), out.region().width(), 0.0f);
    }

private:
    Params m;
    std::vector<ChannelPick> m_picks;
};
RAYLOOM_NODE(Pass);

} // namespace
} // namespace rayloom

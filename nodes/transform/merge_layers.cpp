// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/render_roles.h"
#include "rayloom/core/registry.h"
#include "rayloom/core/text.h"
#include "rayloom/image/rows.h"

#include <algorithm>
#include <cstring>
#include <optional>

namespace rayloom
{
namespace
{

/// transform.merge_layers: a list of images becomes one image with prefixed channels.
class MergeLayers final : public Node
{
public:
    struct Params {
        std::vector<std::string> names, roles;
        std::string renderer = "auto";
    };
    static void describe(Declaration<Params>& d)
    {
        d.name("transform.merge_layers")
            .summary("Puts images into one as its layers.")
            .doc("Channel R of an image named DiffDir becomes DiffDir.R. With an image at `into`, "
                 "its channels come first and stay bit for bit, except that a channel of a layer "
                 "that is named again is replaced in its place: split, filter some layers, and "
                 "merge into the original gives back the same file with those layers filtered. As "
                 "in transform.layers a layer of `into` may be named by its last part, or all by "
                 "their "
                 "roles (`roles`), whatever the renderer calls them. The result "
                 "covers all data windows; outside its own an image is zero.")
            .version(2)
            .accuracy("Exact.")
            .example("rayloom: 1\nname: merge\ninputs:\n  direct: {doc: filtered direct light}\n"
                     "  indirect: {doc: filtered indirect light}\nnodes:\n"
                     "  merged: {op: transform.merge_layers, layers: [direct, indirect], names: "
                     "[DiffDir, DiffInd]}\noutputs:\n  image: merged\n");
        d.input("layers", "the images, in the order of `names`").list();
        d.input("into", "an image to put the layers into").optional();
        d.output("image", "one image with channels named layer.channel");
        d.param("names", &Params::names,
                "layer name of each image; an empty one leaves its channels without a layer");
        d.param(
            "roles", &Params::roles,
            "instead of names: the role each image has in `into` (beauty, diffuse_indirect, …)");
        d.param("renderer", &Params::renderer,
                "renderer map that knows the roles; auto: the one that knows most layers");
    }
    explicit MergeLayers(const Params& params) : m(params) {}

    void plan(PlanContext& context) override
    {
        const std::size_t n = context.count("layers");
        if (n == 0) throw NodeError("'layers' is empty");
        if (m.names.empty() == m.roles.empty())
            throw NodeError("give either 'names' or 'roles', one for each image");
        const std::vector<std::string> names = m.roles.empty() ? m.names : names_of_roles(context);
        if (names.size() != n)
            throw NodeError("'layers' has " + std::to_string(n) + " images and '" +
                            (m.roles.empty() ? "names" : "roles") + "' " +
                            std::to_string(names.size()) + " names; give one name an image");
        m_sources.clear();
        ImageDesc result = context.has("into") ? context.input("into") : context.input("layers", 0);
        std::vector<LayerChannels> existing;
        if (context.has("into")) {
            existing = layers_of(result);
            for (int c = 0; c < result.channel_count(); ++c) m_sources.push_back({{}, c});
        } else {
            result.channels.clear();
        }
        std::vector<bool> written(result.channels.size(), false);
        for (std::size_t i = 0; i < n; ++i) {
            const ImageDesc& image = context.input("layers", i);
            const LayerChannels* layer = find_layer(existing, names[i]);
            const std::string prefix = layer ? layer->layer : names[i];
            for (int c = 0; c < image.channel_count(); ++c) {
                const std::string& channel = image.channels[static_cast<std::size_t>(c)];
                const std::string name = prefix.empty() ? channel : prefix + "." + channel;
                int at = result.channel(name);
                if (at < 0) {
                    at = result.channel_count();
                    result.channels.push_back(name);
                    m_sources.push_back({});
                    written.push_back(false);
                }
                const auto k = static_cast<std::size_t>(at);
                if (written[k])
                    throw NodeError("two images give the channel '" + name +
                                    "'; give them different names in 'names'");
                m_sources[k] = {i, c};
                written[k] = true;
            }
            result.data = result.data.hull(image.data);
            result.display = result.display.hull(image.display);
        }
        for (std::size_t k = 0; k < m_sources.size(); ++k) {
            const Source& source = m_sources[k];
            const char* port = source.layer ? "layers" : "into";
            const std::size_t element = source.layer.value_or(0);
            // A wider window adds zeros: the channel is then not the same image any more.
            if (context.input(port, element).data == result.data)
                context.pass_channel("image", static_cast<int>(k), port, source.channel, 0,
                                     element);
        }
        context.output("image", std::move(result));
    }
    void compute(const TileContext& context) const override
    {
        const Region& region = context.region();
        const ImageView out = context.output("image");
        for (std::size_t k = 0; k < m_sources.size(); ++k) {
            const Source& source = m_sources[k];
            Rows rows(source.layer ? context.input("layers", *source.layer) : context.input("into"),
                      region);
            for (int y = region.y0; y < region.y1; ++y)
                std::memcpy(out.row(static_cast<int>(k), y), rows.row(source.channel, y),
                            static_cast<std::size_t>(region.width()) * sizeof(float));
        }
    }

private:
    std::vector<std::string> names_of_roles(const PlanContext& context) const
    {
        if (!context.has("into")) throw NodeError("'roles' are those of layers of 'into'");
        const RenderRoles roles(context.input("into"), m.renderer);
        std::vector<std::string> names;
        for (const std::string& role : m.roles) {
            const int found = roles.find(role);
            if (found < 0)
                throw NodeError("no layer of 'into' is the " + role + " of a " + roles.renderer() +
                                " render");
            names.push_back(roles.layers()[static_cast<std::size_t>(found)].layer);
        }
        return names;
    }

    struct Source {
        std::optional<std::size_t> layer; ///< element of the list; none: the image at `into`
        int channel = 0;
    };
    Params m;
    std::vector<Source> m_sources;
};
RAYLOOM_NODE(MergeLayers);

} // namespace
} // namespace rayloom

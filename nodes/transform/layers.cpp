// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/channel_picks.h"
#include "rayloom/core/registry.h"

#include <algorithm>

namespace rayloom
{
namespace
{

/// transform.layers: an image that carries many layers becomes a list with one image a layer.
class Layers final : public Node
{
public:
    struct Params {
        std::vector<std::string> layers;
        std::vector<std::string> channels;
    };
    static void describe(Declaration<Params>& d)
    {
        d.name("transform.layers")
            .summary("Splits an image that carries many layers into a list of images.")
            .doc("The list follows the order of `layers`, so that `split.layers[0]` is the first "
                 "one named; a node that takes one image is applied to each. Layers may be named "
                 "by their last part when that is unambiguous. What is taken is passed on bit for "
                 "bit; transform.merge_layers puts the images back.")
            .accuracy("Exact.")
            .example("rayloom: 1\nname: layers\ninputs:\n  render: {doc: a multi-layer image, "
                     "channels: \"DiffDir.R,DiffDir.G,DiffDir.B,DiffInd.R,DiffInd.G,DiffInd.B\"}\n"
                     "nodes:\n  split: {op: transform.layers, image: render, layers: [DiffDir, "
                     "DiffInd]}\noutputs:\n  direct: split.layers[0]\n  indirect: "
                     "split.layers[1]\n");
        d.input("image", "an image with channels named layer.channel");
        d.output("layers", "one image a layer, its channels named without the layer").list();
        d.param("layers", &Params::layers,
                "layers to take, each in full or its last part; empty: every layer of the image");
        d.param("channels", &Params::channels,
                "channels to keep of every layer: R, NEW=R to rename, A=1 for a constant; empty: "
                "all");
    }
    explicit Layers(const Params& params) : m(params) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& image = context.input("image");
        const auto layers = layers_of(image);
        std::vector<std::string> wanted = m.layers;
        if (wanted.empty())
            for (const LayerChannels& layer : layers) wanted.push_back(layer.layer);
        m_picks.clear();
        std::vector<ImageDesc> images;
        for (const std::string& name : wanted) {
            const LayerChannels& layer = require_layer(layers, name);
            m_picks.push_back(parse_channel_picks(m.channels.empty() ? layer.names : m.channels,
                                                  layer.names, layer.indices));
            images.push_back(image.with_channels(pick_names(m_picks.back())));
        }
        context.output_list("layers", std::move(images));
        for (std::size_t i = 0; i < m_picks.size(); ++i)
            declare_picks(context, "layers", i, m_picks[i]);
    }
    void compute(const TileContext& context) const override
    {
        copy_picks(context.input("image"), m_picks[context.element()], context.output("layers"));
    }

private:
    Params m;
    std::vector<std::vector<ChannelPick>> m_picks;
};
RAYLOOM_NODE(Layers);

} // namespace
} // namespace rayloom

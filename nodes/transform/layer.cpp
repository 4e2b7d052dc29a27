// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/channel_picks.h"
#include "rayloom/core/registry.h"

namespace rayloom
{
namespace
{

/// transform.layer: one layer out of an image that carries many.
class Layer final : public Node
{
public:
    struct Params {
        std::string layer;
        std::vector<std::string> channels;
    };
    static void describe(Declaration<Params>& d)
    {
        d.name("transform.layer")
            .summary("Takes one layer out of an image that carries many.")
            .doc("ViewLayer.DiffDir.R becomes R. The layer may be named by its last part when that "
                 "is unambiguous (DiffDir). What is taken is passed on bit for bit.")
            .accuracy("Exact.")
            .example("rayloom: 1\nname: layer\ninputs:\n  render: {doc: a multi-layer image, "
                     "channels: \"DiffDir.R,DiffDir.G,DiffDir.B\"}\n"
                     "nodes:\n  diffuse: {op: transform.layer, image: render, layer: DiffDir}\n"
                     "outputs:\n  image: diffuse\n");
        d.input("image", "an image with channels named layer.channel");
        d.output("image", "the channels of the layer, named without it");
        d.param("layer", &Params::layer,
                "layer to take, in full or its last part; empty: the channels that have no layer");
        d.param(
            "channels", &Params::channels,
            "channels to keep: R, NEW=R to rename, A=1 for a constant; empty: all of the layer");
    }
    explicit Layer(const Params& params) : m(params) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& image = context.input("image");
        const auto layers = layers_of(image);
        const LayerChannels& layer = require_layer(layers, m.layer);
        m_picks = parse_channel_picks(m.channels.empty() ? layer.names : m.channels, layer.names,
                                      layer.indices);
        context.output("image", image.with_channels(pick_names(m_picks)));
        declare_picks(context, "image", 0, m_picks);
    }
    void compute(const TileContext& context) const override
    {
        copy_picks(context.input("image"), m_picks, context.output("image"));
    }

private:
    Params m;
    std::vector<ChannelPick> m_picks;
};
RAYLOOM_NODE(Layer);

} // namespace
} // namespace rayloom

// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/registry.h"
#include "rayloom/image/exr_reader.h"
#include "rayloom/image/renderer_map.h"

namespace rayloom
{

namespace
{
class ReadDeep final : public Node
{
public:
    struct Params {
        std::string path;
        std::string layer;
        std::string part;
        std::string role;
        std::string channels = "any";
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("io.read_deep")
            .summary("Reads a deep image: any number of samples per pixel.")
            .doc(
                "Rows of samples come in the order they are stored; nothing is merged or sorted. "
                "Layers and channels are addressed as in io.read.\n\n"
                "Errors: a file that is missing, truncated or no image, a layer or channel it does "
                "not have, a part that is not deep.");
        d.example(R"(rayloom: 1
name: read-deep-example
doc: Takes the deep samples of a render.
nodes:
  samples: {op: io.read_deep, path: deep.exr, channels: RGB}
outputs:
  deep: samples
)");
        d.output("deep", "deep samples of the selected channels").deep();
        d.param("path", &Params::path, "deep image file, scanline or tiled EXR").required();
        d.param("layer", &Params::layer, "layer, part or channel; empty: the whole first part");
        d.param("part", &Params::part,
                "name or number of the part to look in, where layers of several share a name");
        d.param("role", &Params::role,
                "what the layer is to the renderer ('beauty', 'albedo', …), where no layer is "
                "named; the renderer maps say which layer that is");
        d.param("channels", &Params::channels,
                "'any', 'RGB' (the three colour channels, and alpha where there is one), or a "
                "comma list of names in the order wanted");
    }

    explicit ReadDeep(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        const auto file = ImageFile::open(m.path);
        const ChannelSelection selection =
            choose_channels(*file, {m.layer, m.part, m.role, m.channels});
        m_reader.emplace(file, selection);
        if (!m_reader->part().deep)
            throw NodeError(m.path + ": the image is flat, not deep; read it with io.read");
        context.output("deep", m_reader->desc());
        context.access(Access::rows, m_reader->part().chunk_rows);
        context.cheap();
    }

    void compute(const TileContext&) const override
    {
        throw Error("io.read_deep: deep rows come from read_deep_row()");
    }

    DeepRow read_deep_row(int y) const override { return m_reader->read_deep_row(y); }

    std::string content_key(bool thorough) const override
    {
        return file_content_key(m.path, thorough);
    }

private:
    Params m;
    std::optional<ImageReader> m_reader;
};
} // namespace

RAYLOOM_NODE(ReadDeep);

} // namespace rayloom

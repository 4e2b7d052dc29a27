// SPDX-License-Identifier: Apache-2.0
#include "nodes/io/layer_params.h"
#include "rayloom/image/exr_reader.h"

namespace rayloom
{

namespace
{
class ReadDeep final : public Node
{
public:
    struct Params : LayerParams {
        std::string path;
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
doc: Counts the deep samples of a render by colour.
nodes:
  samples: {op: io.read_deep, path: deep.exr, channels: RGB}
  histogram: {op: transform.histogram, deep: samples}
outputs:
  histogram: histogram
)");
        d.output("deep", "deep samples of the selected channels").deep();
        d.param("path", &Params::path, "deep image file, scanline or tiled EXR").path().required();
        declare_layer_params(d);
    }

    explicit ReadDeep(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        const auto file = ImageFile::open(m.path);
        const ChannelSelection selection = m.choose(*file);
        m_reader.emplace(file, selection);
        if (!m_reader->part().deep)
            throw InputError(m.path + ": the image is flat, not deep; read it with io.read");
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

// SPDX-License-Identifier: Apache-2.0
#include "nodes/io/layer_params.h"
#include "rayloom/core/deep_node.h"
#include "rayloom/image/deep_rows.h"
#include "rayloom/image/exr_reader.h"

namespace rayloom
{

namespace
{
class ReadDeep final : public DeepSource
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
                "Samples come in the order they are stored; nothing is merged or sorted. Ids "
                "(32-bit "
                "integers) keep their bits. "
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
        m_row_samples = m_reader->deep_row_samples();
        // A block as the library decodes it, and the rows made of it.
        context.scratch(2 * static_cast<std::size_t>(m_reader->part().chunk_rows) *
                        deep_row_bytes(m_reader->desc().data.width(),
                                       m_reader->desc().channel_count(), m_row_samples));
        context.cheap();
    }

    DeepRow read_deep_row(int y) const override { return m_reader->read_deep_row(y); }
    std::size_t row_samples() const override { return m_row_samples; }

    std::string content_key(bool thorough) const override
    {
        return file_content_key(m.path, thorough);
    }

private:
    Params m;
    std::optional<ImageReader> m_reader;
    std::size_t m_row_samples = 0;
};
} // namespace

RAYLOOM_NODE(ReadDeep);

} // namespace rayloom

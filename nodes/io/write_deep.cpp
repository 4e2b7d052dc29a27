// SPDX-License-Identifier: Apache-2.0
#include "nodes/io/count_written.h"
#include "rayloom/core/registry.h"
#include "rayloom/image/exr_deep_writer.h"

namespace rayloom
{

namespace
{
class WriteDeep final : public Node
{
public:
    struct Params {
        std::string path;
        std::string layer;
        std::string type;
        std::string compression;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("io.write_deep")
            .summary("Writes a deep image to a deep scanline EXR.")
            .doc("Rows are written as they are made: the image is never whole in memory. The file "
                 "appears under its name complete or not at all, as with io.write.\n\n"
                 "Samples keep their order and number. Each channel keeps the type it has in the "
                 "file the image came from (half, float, 32-bit integer ids); a channel a node "
                 "made is half when it is colour or alpha, else float. Metadata and windows are "
                 "those of that file.\n\n"
                 "Values too large for a half are written as ±65504, NaN and infinities as they "
                 "are; both are counted in the report.\n\n"
                 "Errors: a folder that is missing or cannot be written to, a full disk, a file "
                 "that is not named .exr, a compression a deep EXR cannot have.");
        d.example(R"(rayloom: 1
name: write-deep-example
doc: Gives a deep render the colour of a denoised one.
inputs:
  color: {doc: denoised radiance}
nodes:
  samples: {op: io.read_deep, path: deep.exr}
  recolored: {op: transform.deep_recolor, deep: samples, color: color}
  file: {op: io.write_deep, deep: recolored, path: out.exr}
outputs:
  color: color
)");
        d.input("deep", "the deep pixels to write").deep();
        d.param("path", &Params::path, "EXR file to write").path().required();
        d.param("layer", &Params::layer, "layer to write the channels under; empty: plain names");
        d.param("type", &Params::type,
                "pixel type: half or float; empty: each channel as its source had. Ids stay "
                "integers");
        d.param("compression", &Params::compression,
                "compression: none, rle or zips; empty: as the source, else zips");
    }

    explicit WriteDeep(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& deep = context.input("deep");
        m_writer = std::make_unique<DeepWriter>(
            deep, WriteOptions{m.path, m.type, m.compression, m.layer, {}});
        context.sink(deep.data);
        context.access(Access::rows);
        context.scratch(DeepWriter::packed_bytes);
        for (const std::string& note : m_writer->notes()) context.note(note);
    }

    void compute(const TileContext& context) const override
    {
        const WriteCounts before = m_writer->counts();
        m_writer->write(context.deep("deep"), context.region());
        count_written(context, before, m_writer->counts());
    }

    void commit() override { m_writer->commit(); }
    void abandon() noexcept override
    {
        if (m_writer) m_writer->abandon();
    }

private:
    Params m;
    std::unique_ptr<DeepWriter> m_writer;
};
} // namespace

RAYLOOM_NODE(WriteDeep);

} // namespace rayloom

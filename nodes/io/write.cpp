// SPDX-License-Identifier: Apache-2.0
#include "nodes/io/count_written.h"
#include "rayloom/core/registry.h"
#include "rayloom/image/exr_writer.h"

namespace rayloom
{

namespace
{
class WriteImage final : public Node
{
public:
    struct Params {
        std::string path;
        std::string layer;
        std::string type;
        std::string compression;
        std::string pass_through;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("io.write")
            .summary("Writes an image to a file, alone or in place of a layer of an EXR.")
            .doc("The file appears under its name complete or not at all: it is written without a "
                 "name, or under a hidden one, in the same folder and renamed at the end; an "
                 "earlier file stays until then, and a run that fails or is stopped leaves "
                 "nothing.\n\n"
                 "Pixel types, compression, metadata and windows are those of the file the image "
                 "came from unless a parameter says otherwise. With a template, every other layer "
                 "and part of that EXR is written too, bit for bit: ids and cryptomattes keep "
                 "their bits, channels their types, parts their structure.\n\n"
                 "Values too large for a half are written as ±65504, NaN and infinities as they "
                 "are; both are counted in the report. Values are never converted: PNG and JPEG "
                 "hold the linear values, clipped to 0..1 (convert for display first).\n\n"
                 "Errors: a folder that is missing or cannot be written to, a full disk, a format "
                 "nobody knows, a template without room for the image.");
        d.example(R"(rayloom: 1
name: write-example
doc: Puts an image in the place of a layer of a render and keeps all its other layers.
inputs:
  image: {doc: linear radiance}
nodes:
  file: {op: io.write, image: image, path: out.exr, template: render.exr, layer: Combined}
outputs:
  image: image
)");
        d.input("image", "the pixels to write");
        d.param("path", &Params::path, "file to write; its ending says the format")
            .path()
            .required();
        d.param("layer", &Params::layer,
                "layer to write under; with a template, the layer to replace or to add (empty: its "
                "beauty)");
        d.param("type", &Params::type,
                "pixel type: half, float, uint8 or uint16; empty: each channel as its source had");
        d.param("compression", &Params::compression,
                "compression as OpenImageIO names it (zip, dwaa:45, none); empty: as the source");
        d.param("template", &Params::pass_through,
                "EXR whose other layers, parts and metadata are written too, bit for bit")
            .path();
    }

    explicit WriteImage(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& image = context.input("image");
        m_writer = std::make_unique<ImageWriter>(
            image, WriteOptions{m.path, m.type, m.compression, m.layer, m.pass_through});
        context.sink(image.data);
        context.access(Access::rows, m_writer->row_alignment());
        for (const std::string& note : m_writer->notes()) context.note(note);
    }

    void compute(const TileContext& context) const override
    {
        const WriteCounts before = m_writer->counts();
        m_writer->write(context.input("image").crop(context.region()));
        count_written(context, before, m_writer->counts());
    }

    void commit() override { m_writer->commit(); }
    void abandon() noexcept override
    {
        if (m_writer) m_writer->abandon();
    }

private:
    Params m;
    std::unique_ptr<ImageWriter> m_writer;
};
} // namespace

RAYLOOM_NODE(WriteImage);

} // namespace rayloom

// SPDX-License-Identifier: Apache-2.0
#include "nodes/io/layer_params.h"
#include "rayloom/core/file_source.h"
#include "rayloom/image/exr_reader.h"

namespace rayloom
{

namespace
{
class ReadImage final : public FileSource
{
public:
    struct Params : LayerParams {
        std::string path;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("io.read")
            .summary("Reads an image, or one layer of it, from a file.")
            .doc(
                "Pixels come as linear float32 at the places the file's data window gives them; "
                "metadata, windows and pixel types travel along for whoever writes a descendant of "
                "the image. Only the header is read before the run starts. Files are read "
                "directly, in the blocks they are compressed in, and never cached. Layers of one "
                "file that are read in the same run are unpacked together.\n\n"
                "The layer is addressed by its name ('ViewLayer.Combined'), its part ('beauty'), "
                "both ('beauty.Combined'), its last word where no other layer has it "
                "('Combined'), or as one channel ('ViewLayer.Depth.Z'). Without a layer the "
                "whole first part is read, under full channel names when it has several "
                "layers.\n\n"
                "Errors: a file that is missing, truncated or no image, a layer or channel it does "
                "not have (the message lists what there is), a deep part.");
        d.example(R"(rayloom: 1
name: read-example
doc: Takes one layer of a render.
nodes:
  beauty: {op: io.read, path: render.exr, layer: Combined, channels: RGB}
outputs:
  image: beauty
)");
        d.output("image", "pixels of the selected channels");
        d.param("path", &Params::path, "image file; any format OpenImageIO reads")
            .path()
            .required();
        declare_layer_params(d);
    }

    explicit ReadImage(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        const auto file = ImageFile::open(m.path);
        const ChannelSelection selection = m.choose(*file);
        m_reader.emplace(file, selection);
        const PartInfo& part = m_reader->part();
        if (part.deep)
            throw InputError(
                m.path + ": " +
                (selection.layer.empty() ? "the image" : "'" + selection.layer + "'") +
                " is deep; read it with io.read_deep (an input of a graph: kind: deep)");
        context.output("image", m_reader->desc());
        context.access(Access::rows, part.chunk_rows);
        context.scratch(m_reader->scratch_bytes());
        context.cheap();
        if (!selection.layer.empty()) context.note("layer '" + selection.layer + "' of " + m.path);
    }

    void compute(const TileContext& context) const override
    {
        m_reader->read(context.output("image"));
    }

    const ImageReader& reader(std::size_t) const override { return *m_reader; }

    std::string content_key(bool thorough) const override
    {
        return file_content_key(m.path, thorough);
    }

private:
    Params m;
    std::optional<ImageReader> m_reader;
};
} // namespace

RAYLOOM_NODE(ReadImage);

} // namespace rayloom

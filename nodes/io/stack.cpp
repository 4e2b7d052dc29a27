// SPDX-License-Identifier: Apache-2.0
#include "nodes/io/layer_params.h"
#include "rayloom/core/file_source.h"
#include "rayloom/core/text.h"
#include "rayloom/image/exr_reader.h"

#include <algorithm>
#include <numeric>

namespace rayloom
{

namespace
{
// Files one stack keeps open at once, well under what a process may have.
constexpr std::size_t max_open = 128;

class ReadStack final : public FileSource
{
public:
    struct Params : LayerParams {
        std::vector<std::string> paths;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("io.stack")
            .summary("Reads the same layer of several files as a list of images.")
            .doc("For stacks of independent renders of one frame (other seeds), and for frames of "
                 "an "
                 "animation. Every file must have the same data window, display window and "
                 "channels; an error names the two files that differ. Layers and channels are "
                 "addressed as in io.read.\n\n"
                 "Errors: those of io.read, for any of the files; an empty list.");
        d.example(R"(rayloom: 1
name: stack-example
doc: Takes one layer of several renders of the same picture.
nodes:
  renders: {op: io.stack, paths: [s1.exr, s2.exr], layer: Combined, channels: RGB}
outputs:
  images: renders
)");
        d.output("stack", "one image per file, in the order of the list").list();
        d.param("paths", &Params::paths, "image files").path().required();
        declare_layer_params(d);
    }

    explicit ReadStack(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        if (m.paths.empty()) throw NodeError("the stack has no file; give at least one path");
        m_readers.clear();
        std::vector<ImageDesc> descs;
        int alignment = 1;
        std::size_t scratch = 0;
        for (const std::string& path : m.paths) {
            const auto file = ImageFile::open(path);
            m_readers.emplace_back(file, m.choose(*file));
            const ImageReader& reader = m_readers.back();
            if (reader.part().deep)
                throw InputError(path + ": is deep; a stack is made of flat images");
            const ImageDesc& desc = reader.desc();
            if (!descs.empty()) require_same(descs.front(), desc, path);
            descs.push_back(desc);
            alignment = std::lcm(alignment, reader.part().chunk_rows);
            scratch = std::max(scratch, reader.scratch_bytes());
        }
        if (alignment > 4096) alignment = m_readers.front().part().chunk_rows;
        context.output_list("stack", std::move(descs));
        context.access(Access::rows, alignment);
        context.scratch(scratch);
        context.cheap();
    }

    void compute(const TileContext& context) const override
    {
        const std::size_t element = context.element();
        m_readers[element].read(context.output("stack"));
        // A run may go through the elements band by band; where that means too many open files,
        // each is opened again for every band.
        if (m_readers.size() > max_open || context.region().y1 >= m_readers[element].desc().data.y1)
            m_readers[element].release();
        else
            m_readers[element].trim();
    }

    const ImageReader& reader(std::size_t element) const override { return m_readers[element]; }

    std::string content_key(bool thorough) const override
    {
        std::string key;
        for (const std::string& path : m.paths) key += file_content_key(path, thorough) + "\n";
        return key;
    }

private:
    void require_same(const ImageDesc& first, const ImageDesc& desc, const std::string& path) const
    {
        const std::string files = m.paths.front() + " and " + path;
        if (first.data != desc.data)
            throw InputError(files +
                             ": the files of a stack must have the same data window; they "
                             "have " +
                             first.data.text() + " and " + desc.data.text());
        if (first.display != desc.display)
            throw InputError(files +
                             ": the files of a stack must have the same display window; "
                             "they have " +
                             first.display.text() + " and " + desc.display.text());
        if (first.channels != desc.channels)
            throw InputError(files +
                             ": the files of a stack must have the same channels; they have " +
                             join_names(first.channels) + "; and " + join_names(desc.channels) +
                             "; name the layer or channels to take");
    }

    Params m;
    std::vector<ImageReader> m_readers;
};
} // namespace

RAYLOOM_NODE(ReadStack);

} // namespace rayloom

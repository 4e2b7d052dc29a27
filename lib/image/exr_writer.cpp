// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/exr_writer.h"

#include "rayloom/core/error.h"
#include "rayloom/core/text.h"
#include "rayloom/image/atomic_file.h"
#include "rayloom/image/exr_output.h"
#include "rayloom/image/exr_reader.h"
#include "rayloom/image/half.h"
#include "rayloom/image/image_input.h"
#include "rayloom/image/renderer_map.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfDeepScanLineInputPart.h>
#include <OpenEXR/ImfDeepScanLineOutputPart.h>
#include <OpenEXR/ImfDeepTiledInputPart.h>
#include <OpenEXR/ImfDeepTiledOutputPart.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfTiledInputPart.h>
#include <OpenEXR/ImfTiledOutputPart.h>
#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <OpenImageIO/strutil.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <optional>
#include <unistd.h>

namespace rayloom
{

namespace
{
constexpr std::size_t band_bytes = std::size_t{16} << 20;

// Lets OpenImageIO write into an AtomicFile; its failures are told in the file's own words.
class AtomicProxy final : public OIIO::Filesystem::IOProxy
{
public:
    explicit AtomicProxy(AtomicFile& file) : IOProxy(file.path(), Write), m_file(&file) {}
    const char* proxytype() const override { return "rayloom"; }
    void close() override { m_mode = Closed; }
    int64_t tell() override { return static_cast<int64_t>(m_file->tell()); }
    bool seek(int64_t offset) override
    {
        return offset >= 0 && quietly([&] { m_file->seek(static_cast<std::uint64_t>(offset)); });
    }
    size_t write(const void* data, size_t bytes) override
    {
        const bool ok = quietly([&] { m_file->write(data, bytes); });
        m_size = std::max<size_t>(m_size, m_file->tell());
        return ok ? bytes : 0;
    }
    size_t pwrite(const void* data, size_t bytes, int64_t offset) override
    {
        const int64_t here = tell();
        const size_t n = seek(offset) ? write(data, bytes) : 0;
        return seek(here) ? n : 0;
    }
    size_t size() const override { return m_size; }

private:
    template <class Call>
    bool quietly(const Call& call)
    {
        try {
            call();
            return true;
        } catch (const OutputError& e) {
            m_error = e.what();
            return false;
        }
    }
    AtomicFile* m_file;
    size_t m_size = 0;
};

// Rows of `rows` as half, with counts.
void pack_half(ConstImageView rows, int channel, int y, std::uint16_t* to, WriteCounts& counts)
{
    const auto from = rows.row_span(channel, y);
    const HalfCounts c = float_to_half(from.data(), to, from.size());
    counts.half_overflows += c.overflows;
    counts.non_finite += c.non_finite;
}

void count_non_finite(std::span<const float> values, WriteCounts& counts)
{
    for (const float v : values) counts.non_finite += !std::isfinite(v);
}
} // namespace

// What the two ways of writing share.
struct ImageWriter::State {
    State(const ImageDesc& d, WriteOptions o) : desc(d), options(std::move(o)), next_row(d.data.y0)
    {
    }
    virtual ~State() = default;
    State(const State&) = delete;
    State& operator=(const State&) = delete;

    virtual void open() = 0;
    virtual void put(ConstImageView rows) = 0; ///< whole blocks, or the last rows
    virtual void finish() = 0;                 ///< all rows were put; the file may be closed
    virtual void close() noexcept = 0;         ///< drop what writes into `file`

    [[noreturn]] void fail(const std::string& why)
    {
        const std::string message =
            file && !file->failure().empty()
                ? file->failure()
                : options.path + ": cannot be written: " + plain_message(why, options.path);
        close();
        file.reset();
        throw OutputError(message);
    }
    /// Runs a library call; whatever it throws becomes an OutputError, except our own errors.
    template <class Call>
    void guarded(const Call& call)
    {
        try {
            call();
        } catch (const InputError&) {
            close();
            file.reset();
            throw;
        } catch (const OutputError& e) {
            fail(e.what());
        } catch (const std::bad_alloc&) {
            close();
            file.reset();
            throw MemoryError(options.path + ": no memory to write rows");
        } catch (const std::exception& e) {
            fail(e.what());
        }
    }

    ImageDesc desc;
    WriteOptions options;
    int alignment = 1;
    std::vector<std::string> notes;
    WriteCounts counts;
    std::unique_ptr<AtomicFile> file;
    bool opened = false, finished = false;
    int next_row;
    ImageBuffer gathered; ///< rows that do not fill a block yet
    int gathered_rows = 0;
};

namespace
{
/// A new file through OpenImageIO.
template <class Base>
struct NewFile final : Base {
    using Base::counts, Base::desc, Base::fail, Base::file, Base::options;

    NewFile(const ImageDesc& d, WriteOptions o) : Base(d, std::move(o))
    {
        exr = is_exr(options.path);
        const auto probe = OIIO::ImageOutput::create(options.path);
        if (!probe) {
            const std::string extension = std::filesystem::path(options.path).extension().string();
            OIIO::geterror();
            throw OutputError(options.path + ": there is no image format '" + extension +
                              "'; write .exr, .tif, .png or another OpenImageIO knows");
        }
        proxied = probe->supports("ioproxy") != 0;
        make_spec(*probe);
    }
    ~NewFile() override { close(); }

    void make_spec(const OIIO::ImageOutput& probe)
    {
        spec = header_without_channels(desc);
        const std::string source_compression = spec.get_string_attribute("compression");
        for (int i = 0; i < static_cast<int>(desc.channels.size()); ++i) kept.push_back(i);
        if (!exr && probe.supports("alpha") == 0 && desc.alpha() >= 0 && desc.channel_count() > 1)
            kept.erase(kept.begin() + desc.alpha());
        spec.nchannels = static_cast<int>(kept.size());
        if (exr) {
            spec.channelnames = full_names(options.path, options.layer, desc.channels);
        } else if (!options.layer.empty()) {
            throw NodeError(options.path + ": layer '" + options.layer +
                            "' can be written to EXR alone");
        }
        for (std::size_t i = 0; i < kept.size(); ++i) {
            const std::string& name = desc.channels[static_cast<std::size_t>(kept[i])];
            if (!exr) spec.channelnames.push_back(name);
            if (kept[i] == desc.alpha()) spec.alpha_channel = static_cast<int>(i);
            if (exr) types.push_back(exr_type(desc, name, options.path, options.type));
        }
        if (exr) {
            for (const OIIO::TypeDesc& t : types)
                if (t != OIIO::TypeHalf && t != OIIO::TypeFloat)
                    throw NodeError(options.path + ": EXR holds half and float, not " +
                                    options.type);
            spec.format = types.front();
            spec.channelformats = types;
            if (std::all_of(types.begin(), types.end(),
                            [&](const OIIO::TypeDesc& t) { return t == types.front(); }))
                spec.channelformats.clear();
            drop_orphaned_manifests(spec);
        } else {
            spec.format = plain_format();
        }
        if (exr && !options.compression.empty())
            compression_named(options.path, options.compression);
        if (!options.compression.empty())
            spec.attribute("compression", options.compression);
        else if (exr && source_compression.empty())
            spec.attribute("compression", "zip");
        if (exr) this->alignment = 32; // the largest common block; others divide it
        std::size_t row = 0;
        for (const OIIO::TypeDesc& t : types) row += t.size();
        pixel_bytes = exr ? row : spec.channelnames.size() * sizeof(float);
        const std::string layer = options.layer.empty() ? "" : options.layer + ": ";
        this->notes.push_back(options.path + ": " + layer + join_names(desc.channels) + " written");
    }

    OIIO::TypeDesc plain_format() const
    {
        if (!options.type.empty()) return parse_type(options.path, options.type);
        const auto source = source_type(desc, desc.channels.front());
        if (source && (*source == OIIO::TypeUInt8 || *source == OIIO::TypeUInt16)) return *source;
        for (const char* e : {".tif", ".tiff", ".hdr", ".pfm", ".rgbe", ".zfile"})
            if (OIIO::Strutil::iends_with(options.path, e)) return OIIO::TypeFloat;
        return OIIO::TypeUInt8;
    }

    void open() override
    {
        file = std::make_unique<AtomicFile>(options.path);
        output = OIIO::ImageOutput::create(options.path);
        if (!output) fail(OIIO::geterror());
        std::string name = options.path;
        if (proxied) {
            proxy.emplace(*file);
            if (!output->set_ioproxy(&*proxy)) fail("the format does not take a stream");
        } else {
            // A format that only writes named files gets one of its own, copied at the end.
            const std::filesystem::path path(options.path);
            side_file = (path.parent_path() /
                         ("." + path.stem().string().substr(0, 180) + "." +
                          std::to_string(::getpid()) + ".part" + path.extension().string()))
                            .string();
            name = side_file;
        }
        if (!output->open(name, spec)) fail(output->geterror());
    }

    void put(ConstImageView rows) override
    {
        const Region& r = rows.region();
        const auto width = static_cast<std::size_t>(r.width());
        const int at_once = static_cast<int>(
            std::max<std::size_t>(32, band_bytes / std::max<std::size_t>(1, width * pixel_bytes)));
        for (int y0 = r.y0; y0 < r.y1; y0 += at_once) {
            const int y1 = std::min(r.y1, y0 + at_once);
            pixels.resize(width * pixel_bytes * static_cast<std::size_t>(y1 - y0));
            for (int y = y0; y < y1; ++y)
                pack_row(rows, y,
                         pixels.data() + static_cast<std::size_t>(y - y0) * width * pixel_bytes);
            if (!output->write_scanlines(y0, y1, 0, exr ? OIIO::TypeUnknown : OIIO::TypeFloat,
                                         pixels.data()))
                fail(output->geterror());
        }
    }

    void pack_row(ConstImageView rows, int y, std::byte* to)
    {
        const auto width = static_cast<std::size_t>(rows.region().width());
        std::size_t offset = 0;
        halves.resize(width);
        for (std::size_t i = 0; i < kept.size(); ++i) {
            std::byte* out = to + offset;
            if (exr && types[i] == OIIO::TypeHalf) {
                pack_half(rows, kept[i], y, halves.data(), counts);
                for (std::size_t x = 0; x < width; ++x)
                    std::memcpy(out + x * pixel_bytes, &halves[x], sizeof(std::uint16_t));
                offset += sizeof(std::uint16_t);
            } else {
                const auto from = rows.row_span(kept[i], y);
                count_non_finite(from, counts);
                for (std::size_t x = 0; x < width; ++x)
                    std::memcpy(out + x * pixel_bytes, &from[x], sizeof(float));
                offset += sizeof(float);
            }
        }
    }

    void finish() override
    {
        if (!output->close()) fail(output->geterror());
        output.reset();
        if (!side_file.empty()) {
            std::ifstream in(side_file, std::ios::binary);
            std::vector<char> block(std::size_t{1} << 20);
            while (in.read(block.data(), static_cast<std::streamsize>(block.size())),
                   in.gcount() > 0)
                file->write(block.data(), static_cast<std::size_t>(in.gcount()));
            close();
        }
    }

    void close() noexcept override
    {
        output.reset();
        if (!side_file.empty()) ::unlink(side_file.c_str());
        side_file.clear();
    }

    bool exr = false, proxied = false;
    OIIO::ImageSpec spec;
    std::vector<int> kept; ///< channels of the image that are written
    std::vector<OIIO::TypeDesc> types;
    std::size_t pixel_bytes = 0;
    std::string side_file;
    std::optional<AtomicProxy> proxy;
    std::unique_ptr<OIIO::ImageOutput> output;
    std::vector<std::byte> pixels;
    std::vector<std::uint16_t> halves;
};

/// A copy of an EXR with some channels of one part replaced or added. Through OpenEXR itself, so
/// that every attribute and every compressed block nobody touches is copied as it stands.
template <class Base>
struct MergedFile final : Base {
    using Base::counts, Base::desc, Base::fail, Base::file, Base::options;

    MergedFile(const ImageDesc& d, WriteOptions o) : Base(d, std::move(o))
    {
        if (!is_exr(options.path))
            throw NodeError(options.path +
                            ": other layers can be kept in an EXR only; write to a .exr");
        source = ImageFile::open(options.template_path);
        if (std::string_view(source->format()) != "openexr")
            throw NodeError(options.template_path +
                            ": only the layers of an EXR can be kept, and this is " +
                            source->format());
        find_place();
        const Imf::MultiPartInputFile headers = open_source();
        const Imf::Header& header = headers.header(part);
        const PartInfo& info = source->parts()[static_cast<std::size_t>(part)];
        if (info.deep)
            throw NodeError(options.template_path + ": part '" + info.name +
                            "' is deep; a flat layer cannot be put into it");
        if (!info.data.contains(desc.data))
            throw NodeError(options.template_path + ": its data window is " + info.data.text() +
                            ", and the image's, " + desc.data.text() +
                            ", is not inside; crop the image or name another file");
        for (auto it = header.channels().begin(); it != header.channels().end(); ++it)
            if (it.channel().xSampling != 1 || it.channel().ySampling != 1)
                throw NodeError(options.template_path + ": channel '" + it.name() +
                                "' is subsampled; layers beside it cannot be replaced");
        this->alignment = info.chunk_rows;
        describe();
    }
    ~MergedFile() override { close(); }

    Imf::MultiPartInputFile open_source() const
    {
        try {
            return Imf::MultiPartInputFile(options.template_path.c_str());
        } catch (const std::exception& e) {
            throw InputError(options.template_path + ": cannot be read: " + e.what());
        }
    }

    // Which part, and under which full names, the image's channels go.
    void find_place()
    {
        std::optional<LayerInfo> layer;
        const auto take = [&](const ChannelSelection& s) {
            for (const LayerInfo& l : source->layers())
                if (l.part == s.part && std::find(l.channels.begin(), l.channels.end(),
                                                  s.channels.front()) != l.channels.end())
                    layer = l;
        };
        if (options.layer.empty()) {
            const ChannelSelection beauty = default_layer(*source, "beauty");
            take(beauty);
        } else {
            for (const LayerInfo& l : source->layers())
                if (l.address() == options.layer || l.name == options.layer ||
                    l.part_name + "." + l.name == options.layer || l.pass == options.layer) {
                    if (layer &&
                        (l.address() == options.layer) == (layer->address() == options.layer))
                        throw NodeError(options.template_path + ": '" + options.layer +
                                        "' may be '" + layer->address() + "' or '" + l.address() +
                                        "'; write which of them is meant");
                    if (!layer || l.address() == options.layer) layer = l;
                }
        }
        std::string prefix = options.layer;
        if (layer) {
            part = layer->part;
            prefix = layer->name;
            replaced =
                layer->address().empty() ? join_names(layer->channel_names) : layer->address();
        } else {
            // A new layer joins the first flat part of its size.
            part = -1;
            for (const PartInfo& p : source->parts())
                if (part < 0 && !p.deep && p.data.contains(desc.data)) part = p.index;
            if (part < 0)
                throw NodeError(options.template_path + ": has no part that holds " +
                                desc.data.text() + " to add layer '" + options.layer + "' to");
        }
        names = full_names(options.path, prefix, desc.channels);
    }

    void describe()
    {
        for (const LayerInfo& l : source->layers()) {
            const std::string name =
                l.address().empty() ? join_names(l.channel_names) : l.address();
            std::size_t gone = 0;
            for (const std::string& n : l.full_names())
                gone += l.part == part && std::find(names.begin(), names.end(), n) != names.end();
            this->notes.push_back(options.path + ": " + name +
                                  (gone == 0 ? " passed through"
                                   : gone == l.channels.size()
                                       ? " written"
                                       : " written, its other channels passed through"));
        }
        if (replaced.empty()) this->notes.push_back(options.path + ": " + options.layer + " added");
    }

    void open() override
    {
        this->guarded([&] { open_parts(); });
    }

    void open_parts()
    {
        file = std::make_unique<AtomicFile>(options.path);
        stream.emplace(*file);
        input = std::make_unique<Imf::MultiPartInputFile>(options.template_path.c_str());
        std::vector<Imf::Header> headers;
        for (int i = 0; i < input->parts(); ++i) headers.push_back(input->header(i));
        if (headers.size() != source->parts().size())
            throw InputError(options.template_path + ": changed while it was being read");
        adapt(headers[static_cast<std::size_t>(part)]);
        output = std::make_unique<Imf::MultiPartOutputFile>(*stream, headers.data(),
                                                            static_cast<int>(headers.size()));
        for (int i = 0; i < input->parts(); ++i)
            if (i != part) copy_part(i);
        tiled = headers[static_cast<std::size_t>(part)].hasTileDescription();
        rows_in.emplace(*input, part);
        if (tiled)
            tiles_out.emplace(*output, part);
        else
            rows_out.emplace(*output, part);
    }

    // The header of the part that changes.
    void adapt(Imf::Header& header)
    {
        bool keeps_pixels = false;
        for (auto it = header.channels().begin(); it != header.channels().end(); ++it)
            if (std::find(names.begin(), names.end(), it.name()) == names.end())
                keeps_pixels = true;
        for (std::size_t i = 0; i < names.size(); ++i) {
            const Imf::Channel* there = header.channels().findChannel(names[i].c_str());
            Imf::PixelType type = Imf::HALF;
            if (there != nullptr && options.type.empty())
                type = there->type == Imf::HALF ? Imf::HALF : Imf::FLOAT;
            else
                type =
                    exr_type(desc, desc.channels[i], options.path, options.type) == OIIO::TypeHalf
                        ? Imf::HALF
                        : Imf::FLOAT;
            types.push_back(type);
            header.channels().insert(names[i].c_str(), Imf::Channel(type));
        }
        for (auto it = header.channels().begin(); it != header.channels().end(); ++it)
            if (std::find(names.begin(), names.end(), it.name()) == names.end())
                passed.push_back({it.name(), it.channel().type, {}});
        const Region& d = desc.data;
        header.dataWindow() = Imath::Box2i({d.x0, d.y0}, {d.x1 - 1, d.y1 - 1});
        header.lineOrder() = Imf::INCREASING_Y;
        if (header.hasTileDescription()) {
            Imf::TileDescription tiles = header.tileDescription();
            tiles.mode = Imf::ONE_LEVEL;
            header.setTileDescription(tiles);
        }
        // Decoded once more, a lossy block would lose more: what is kept is kept exactly.
        if (!options.compression.empty()) {
            const ExrCompression chosen = compression_named(options.path, options.compression);
            header.compression() = chosen.method;
            if (chosen.level && is_lossy(chosen.method))
                header.dwaCompressionLevel() = *chosen.level;
            else if (chosen.level)
                header.zipCompressionLevel() = static_cast<int>(*chosen.level);
        }
        if (keeps_pixels && is_lossy(header.compression()))
            header.compression() = Imf::ZIP_COMPRESSION;
    }

    static bool is_lossy(Imf::Compression c)
    {
        return c == Imf::PXR24_COMPRESSION || c == Imf::B44_COMPRESSION ||
               c == Imf::B44A_COMPRESSION || c == Imf::DWAA_COMPRESSION ||
               c == Imf::DWAB_COMPRESSION;
    }

    // Compressed blocks, as they are.
    void copy_part(int i)
    {
        const std::string type = input->header(i).type();
        if (type == Imf::DEEPSCANLINE) {
            Imf::DeepScanLineInputPart in(*input, i);
            Imf::DeepScanLineOutputPart(*output, i).copyPixels(in);
        } else if (type == Imf::DEEPTILE) {
            Imf::DeepTiledInputPart in(*input, i);
            Imf::DeepTiledOutputPart(*output, i).copyPixels(in);
        } else if (type == Imf::TILEDIMAGE) {
            Imf::TiledInputPart in(*input, i);
            Imf::TiledOutputPart(*output, i).copyPixels(in);
        } else {
            Imf::InputPart in(*input, i);
            Imf::OutputPart(*output, i).copyPixels(in);
        }
    }

    void put(ConstImageView rows) override
    {
        this->guarded([&] {
            const Region& r = rows.region();
            const auto width = static_cast<std::size_t>(r.width());
            std::size_t row_bytes = 0;
            for (const Passed& p : passed) row_bytes += width * (p.type == Imf::HALF ? 2 : 4);
            for (const Imf::PixelType t : types) row_bytes += width * (t == Imf::HALF ? 2 : 4);
            const int blocks = static_cast<int>(
                std::max<std::size_t>(1, band_bytes / std::max<std::size_t>(1, row_bytes) /
                                             static_cast<std::size_t>(this->alignment)));
            const int at_once = blocks * this->alignment;
            for (int y0 = r.y0; y0 < r.y1; y0 += at_once)
                put_band(rows, y0, std::min(r.y1, y0 + at_once));
        });
    }

    void put_band(ConstImageView rows, int y0, int y1)
    {
        const Region& r = rows.region();
        const auto width = static_cast<std::size_t>(r.width());
        const auto pixels = width * static_cast<std::size_t>(y1 - y0);
        const PartInfo& info = source->parts()[static_cast<std::size_t>(part)];
        const auto source_width = static_cast<std::size_t>(info.data.width());
        Imf::FrameBuffer in, out;
        for (Passed& p : passed) {
            const std::size_t size = p.type == Imf::HALF ? 2 : 4;
            p.pixels.resize(source_width * static_cast<std::size_t>(y1 - y0) * size);
            const Imf::Slice slice =
                slice_of(p.type, p.pixels.data(), info.data.x0, y0, size, source_width * size);
            in.insert(p.name.c_str(), slice);
            out.insert(p.name.c_str(), slice);
        }
        if (!passed.empty()) {
            try {
                rows_in->setFrameBuffer(in);
                rows_in->readPixels(y0, y1 - 1);
            } catch (const std::bad_alloc&) {
                throw;
            } catch (const std::exception& e) {
                throw InputError(options.template_path + ": rows " + std::to_string(y0) + " to " +
                                 std::to_string(y1 - 1) + " cannot be read: " + e.what());
            }
        }
        halves.resize(types.size());
        for (std::size_t i = 0; i < types.size(); ++i) {
            const int c = static_cast<int>(i);
            if (types[i] == Imf::HALF) {
                halves[i].resize(pixels);
                for (int y = y0; y < y1; ++y)
                    pack_half(rows, c, y,
                              halves[i].data() + static_cast<std::size_t>(y - y0) * width, counts);
                out.insert(names[i].c_str(),
                           slice_of(Imf::HALF, halves[i].data(), r.x0, y0, 2, width * 2));
            } else {
                for (int y = y0; y < y1; ++y) count_non_finite(rows.row_span(c, y), counts);
                // OpenEXR's frame buffers are not const; writing only reads them.
                out.insert(names[i].c_str(),
                           slice_of(Imf::FLOAT, const_cast<float*>(rows.row(c, y0)), r.x0, y0, 4,
                                    static_cast<std::size_t>(rows.row_stride()) * 4));
            }
        }
        if (tiled) {
            const auto height = static_cast<int>(tiles_out->tileYSize());
            tiles_out->setFrameBuffer(out);
            tiles_out->writeTiles(0, tiles_out->numXTiles() - 1, (y0 - desc.data.y0) / height,
                                  (y1 - 1 - desc.data.y0) / height);
        } else {
            rows_out->setFrameBuffer(out);
            rows_out->writePixels(y1 - y0);
        }
    }

    static Imf::Slice slice_of(Imf::PixelType type, void* data, int x0, int y0,
                               std::size_t x_stride, std::size_t y_stride)
    {
        return Imf::Slice::Make(type, data, Imath::V2i(x0, y0), 1, 1, x_stride, y_stride);
    }

    void finish() override
    {
        // Destroying the file writes its tables, and would swallow an error: ours is remembered.
        drop();
        if (!file->failure().empty()) fail(file->failure());
    }
    void drop() noexcept
    {
        rows_in.reset();
        rows_out.reset();
        tiles_out.reset();
        output.reset();
        input.reset();
        stream.reset();
    }
    void close() noexcept override { drop(); }

    struct Passed {
        std::string name;
        Imf::PixelType type;
        std::vector<char> pixels;
    };
    std::shared_ptr<const ImageFile> source;
    int part = 0;
    std::string replaced;
    std::vector<std::string> names; ///< per channel of the image
    std::vector<Imf::PixelType> types;
    std::vector<Passed> passed;
    bool tiled = false;
    std::optional<AtomicStream> stream;
    std::unique_ptr<Imf::MultiPartInputFile> input;
    std::unique_ptr<Imf::MultiPartOutputFile> output;
    std::optional<Imf::InputPart> rows_in;
    std::optional<Imf::OutputPart> rows_out;
    std::optional<Imf::TiledOutputPart> tiles_out;
    std::vector<std::vector<std::uint16_t>> halves;
};
} // namespace

ImageWriter::ImageWriter(const ImageDesc& desc, WriteOptions options)
{
    if (desc.data.empty() || desc.channels.empty())
        throw NodeError(options.path + ": there is no pixel to write");
    check_writable(options.path);
    if (options.template_path.empty())
        m_state = std::make_unique<NewFile<State>>(desc, std::move(options));
    else
        m_state = std::make_unique<MergedFile<State>>(desc, std::move(options));
}

ImageWriter::~ImageWriter() { abandon(); }
ImageWriter::ImageWriter(ImageWriter&&) noexcept = default;
ImageWriter& ImageWriter::operator=(ImageWriter&&) noexcept = default;

int ImageWriter::row_alignment() const { return m_state->alignment; }
const std::vector<std::string>& ImageWriter::notes() const { return m_state->notes; }
const WriteCounts& ImageWriter::counts() const { return m_state->counts; }

void ImageWriter::write(ConstImageView rows)
{
    State& s = *m_state;
    const Region& r = rows.region();
    const Region& d = s.desc.data;
    if (r.x0 != d.x0 || r.x1 != d.x1 || r.y0 != s.next_row || r.y1 > d.y1 || r.empty() ||
        rows.channels() != s.desc.channel_count())
        throw OutputError(s.options.path + ": rows " + r.text() + " cannot follow row " +
                          std::to_string(s.next_row) + " of " + d.text());
    if (!s.opened) {
        s.opened = true;
        s.open();
    }
    if (!s.file) throw OutputError(s.options.path + ": writing it has failed before");
    s.next_row = r.y1;
    // Blocks are compressed whole, so rows of one that is not complete wait.
    int y = r.y0;
    const auto boundary = [&](int row) { return (row - d.y0) % s.alignment == 0 || row == d.y1; };
    while (y < r.y1) {
        if (s.gathered_rows == 0 && boundary(y)) {
            const int end = r.y1 == d.y1 ? d.y1 : r.y1 - (r.y1 - d.y0) % s.alignment;
            if (end > y) {
                s.put(rows.crop({r.x0, y, r.x1, end}));
                y = end;
                continue;
            }
        }
        const int block = d.y0 + (y - d.y0) / s.alignment * s.alignment;
        const Region block_region{d.x0, block, d.x1, std::min(d.y1, block + s.alignment)};
        if (s.gathered.region() != block_region)
            s.gathered = ImageBuffer(block_region, s.desc.channel_count());
        const int end = std::min(r.y1, block_region.y1);
        copy_pixels(rows, s.gathered.view().crop({r.x0, y, r.x1, end}));
        s.gathered_rows = end - block;
        y = end;
        if (y == block_region.y1) {
            s.put(s.gathered.view());
            s.gathered_rows = 0;
        }
    }
}

void ImageWriter::commit()
{
    State& s = *m_state;
    if (s.next_row != s.desc.data.y1 || !s.file)
        throw OutputError(s.options.path + ": was not written to its end");
    s.guarded([&] {
        s.finish();
        s.file->commit();
    });
    s.file.reset();
    s.finished = true;
}

void ImageWriter::abandon() noexcept
{
    if (!m_state) return;
    m_state->close();
    m_state->file.reset();
}

} // namespace rayloom

// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/exr_deep_writer.h"

#include "rayloom/core/error.h"
#include "rayloom/core/text.h"
#include "rayloom/image/atomic_file.h"
#include "rayloom/image/deep_rows.h"
#include "rayloom/image/exr_output.h"
#include "rayloom/image/half.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfDeepFrameBuffer.h>
#include <OpenEXR/ImfDeepScanLineOutputFile.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfStdIO.h>
#include <OpenImageIO/filesystem.h>

#include <algorithm>
#include <cmath>
#include <optional>

namespace rayloom
{

namespace
{

/// Metadata as a flat file of the same image has it: OpenImageIO writes a file of one pixel, and
/// its header is taken.
Imf::Header header_of(OIIO::ImageSpec spec, const std::string& path)
{
    spec.width = spec.height = 1;
    spec.nchannels = 1;
    spec.channelnames = {"A"};
    spec.set_format(OIIO::TypeHalf);
    spec.attribute("compression", "none");
    OIIO::Filesystem::IOVecOutput memory;
    const auto output = OIIO::ImageOutput::create("header.exr");
    const float pixel = 0.0f;
    if (!output || !output->set_ioproxy(&memory) || !output->open("header.exr", spec) ||
        !output->write_image(OIIO::TypeFloat, &pixel) || !output->close())
        throw OutputError(
            path + ": cannot be written: " + (output ? output->geterror() : OIIO::geterror()));
    Imf::StdISStream stream;
    stream.str(std::string(memory.buffer().begin(), memory.buffer().end()));
    return Imf::InputFile(stream).header();
}

} // namespace

struct DeepWriter::State {
    State(const ImageDesc& d, WriteOptions o) : desc(d), options(std::move(o)), next_row(d.data.y0)
    {
        if (!is_exr(options.path))
            throw NodeError(options.path + ": only an EXR holds deep images; write to a .exr");
        compression = choose_compression();
        for (const std::string& name : desc.channels) {
            const auto source = source_type(desc, name);
            if (source && source->basetype == OIIO::TypeDesc::UINT32) {
                types.push_back(Imf::UINT);
                continue;
            }
            const OIIO::TypeDesc type = exr_type(desc, name, options.path, options.type);
            if (type != OIIO::TypeHalf && type != OIIO::TypeFloat)
                throw NodeError(options.path + ": EXR holds half and float, not " + options.type);
            types.push_back(type == OIIO::TypeHalf ? Imf::HALF : Imf::FLOAT);
        }
        names = full_names(options.path, options.layer, desc.channels);
        const std::string layer = options.layer.empty() ? "" : options.layer + ": ";
        notes.push_back(options.path + ": " + layer + join_names(desc.channels) + " written, deep");
    }

    Imf::Compression choose_compression() const
    {
        if (!options.compression.empty()) {
            const Imf::Compression c = compression_named(options.path, options.compression).method;
            if (!holds_deep(c))
                throw NodeError(options.path +
                                ": a deep EXR is compressed with none, rle or zips, not '" +
                                options.compression + "'");
            return c;
        }
        const std::string source =
            desc.header ? desc.header->get_string_attribute("compression") : "";
        for (const auto& [name, c] :
             {std::pair{"none", Imf::NO_COMPRESSION}, {"rle", Imf::RLE_COMPRESSION}})
            if (source == name) return c;
        return Imf::ZIPS_COMPRESSION;
    }
    static bool holds_deep(Imf::Compression c)
    {
        return c == Imf::NO_COMPRESSION || c == Imf::RLE_COMPRESSION || c == Imf::ZIPS_COMPRESSION;
    }

    /// Runs a library call; whatever it throws becomes an OutputError, except want of memory.
    template <class Call>
    void guarded(const Call& call)
    {
        try {
            call();
        } catch (const std::bad_alloc&) {
            close();
            file.reset();
            throw MemoryError(options.path + ": no memory to write rows");
        } catch (const std::exception& e) {
            const std::string message = file && !file->failure().empty()
                                            ? file->failure()
                                            : options.path + ": cannot be written: " + e.what();
            close();
            file.reset();
            throw OutputError(message);
        }
    }

    void open()
    {
        OIIO::ImageSpec spec = header_without_channels(desc);
        spec.channelnames = names;
        drop_orphaned_manifests(spec);
        Imf::Header header = header_of(spec, options.path);
        const auto box = [](const Region& r) {
            return Imath::Box2i({r.x0, r.y0}, {r.x1 - 1, r.y1 - 1});
        };
        header.dataWindow() = box(desc.data);
        header.displayWindow() = box(desc.display);
        header.compression() = compression;
        header.lineOrder() = Imf::INCREASING_Y;
        header.channels() = Imf::ChannelList();
        for (std::size_t i = 0; i < types.size(); ++i)
            header.channels().insert(names[i].c_str(), Imf::Channel(types[i]));
        header.setType(Imf::DEEPSCANLINE);
        file = std::make_unique<AtomicFile>(options.path);
        stream.emplace(*file);
        output.emplace(*stream, header);
    }

    /// Rows whose packed samples take about packed_bytes together, so that the library compresses
    /// several at once.
    void put(const DeepView& rows, const Region& region)
    {
        for (int y0 = region.y0; y0 < region.y1;) {
            int y1 = y0;
            std::size_t bytes = 0;
            while (y1 < region.y1 && (y1 == y0 || bytes < packed_bytes))
                bytes += rows.row(y1++).bytes();
            put_band(rows, {region.x0, y0, region.x1, y1});
            y0 = y1;
        }
    }

    void put_band(const DeepView& rows, const Region& band)
    {
        const auto width = static_cast<std::size_t>(band.width());
        const auto pixels = width * static_cast<std::size_t>(band.height());
        const auto from = static_cast<std::size_t>(band.x0 - rows.region.x0);
        std::vector<std::uint32_t> samples(pixels);
        std::vector<std::vector<char*>> pointers(types.size(), std::vector<char*>(pixels));
        std::vector<std::vector<std::uint16_t>> halves;
        std::vector<std::vector<std::uint32_t>> ids;
        for (int y = band.y0; y < band.y1; ++y) {
            const DeepRow& row = rows.row(y);
            const std::size_t base = static_cast<std::size_t>(y - band.y0) * width;
            const std::uint32_t begin = row.first[from], end = row.first[from + width];
            for (std::size_t x = 0; x < width; ++x)
                samples[base + x] = row.first[from + x + 1] - row.first[from + x];
            std::size_t id_channels = 0;
            for (std::size_t c = 0; c < types.size(); ++c) {
                const std::span<const float> values =
                    std::span(row.samples[c]).subspan(begin, end - begin);
                // OpenEXR's frame buffers are not const; writing only reads them.
                char* data = reinterpret_cast<char*>(const_cast<float*>(values.data()));
                std::size_t size = sizeof(float);
                if (types[c] == Imf::HALF) {
                    auto& packed = halves.emplace_back(values.size());
                    const HalfCounts n = float_to_half(values.data(), packed.data(), values.size());
                    counts.half_overflows += n.overflows;
                    counts.non_finite += n.non_finite;
                    data = reinterpret_cast<char*>(packed.data());
                    size = sizeof(std::uint16_t);
                } else if (types[c] == Imf::UINT) {
                    auto& packed = ids.emplace_back(values.size());
                    const std::size_t rest = types.size() + id_channels++;
                    for (std::size_t i = 0; i < packed.size(); ++i)
                        packed[i] =
                            id_of(values[i],
                                  rest < row.samples.size() ? row.samples[rest][begin + i] : 0.0f);
                    data = reinterpret_cast<char*>(packed.data());
                } else {
                    for (const float v : values) counts.non_finite += !std::isfinite(v);
                }
                for (std::size_t x = 0; x < width; ++x)
                    pointers[c][base + x] = data + (row.first[from + x] - begin) * size;
            }
        }
        Imf::DeepFrameBuffer buffer;
        const Imath::V2i origin(band.x0, band.y0);
        buffer.insertSampleCountSlice(Imf::Slice::Make(Imf::UINT, samples.data(), origin, 1, 1,
                                                       sizeof(std::uint32_t),
                                                       width * sizeof(std::uint32_t)));
        const std::ptrdiff_t offset = band.x0 + static_cast<std::ptrdiff_t>(band.y0) * band.width();
        for (std::size_t c = 0; c < types.size(); ++c)
            buffer.insert(names[c].c_str(),
                          Imf::DeepSlice(
                              types[c], reinterpret_cast<char*>(pointers[c].data() - offset),
                              sizeof(char*), width * sizeof(char*), types[c] == Imf::HALF ? 2 : 4));
        output->setFrameBuffer(buffer);
        output->writePixels(band.height());
    }

    void close() noexcept
    {
        output.reset();
        stream.reset();
    }

    ImageDesc desc;
    WriteOptions options;
    Imf::Compression compression = Imf::ZIPS_COMPRESSION;
    std::vector<Imf::PixelType> types;
    std::vector<std::string> names, notes;
    WriteCounts counts;
    std::unique_ptr<AtomicFile> file;
    std::optional<AtomicStream> stream;
    std::optional<Imf::DeepScanLineOutputFile> output;
    bool opened = false;
    int next_row;
};

DeepWriter::DeepWriter(const ImageDesc& desc, WriteOptions options)
{
    if (desc.data.empty() || desc.channels.empty())
        throw NodeError(options.path + ": there is no pixel to write");
    check_writable(options.path);
    m_state = std::make_unique<State>(desc, std::move(options));
}

DeepWriter::~DeepWriter() { abandon(); }
DeepWriter::DeepWriter(DeepWriter&&) noexcept = default;
DeepWriter& DeepWriter::operator=(DeepWriter&&) noexcept = default;

const std::vector<std::string>& DeepWriter::notes() const { return m_state->notes; }
const WriteCounts& DeepWriter::counts() const { return m_state->counts; }

void DeepWriter::write(const DeepView& rows, const Region& region)
{
    State& s = *m_state;
    const Region& d = s.desc.data;
    if (region.x0 != d.x0 || region.x1 != d.x1 || region.y0 != s.next_row || region.y1 > d.y1 ||
        region.empty() || !rows.region.contains(region) || rows.channels != s.desc.channel_count())
        throw OutputError(s.options.path + ": rows " + region.text() + " cannot follow row " +
                          std::to_string(s.next_row) + " of " + d.text());
    if (!s.opened) {
        s.opened = true;
        s.guarded([&] { s.open(); });
    }
    if (!s.file) throw OutputError(s.options.path + ": writing it has failed before");
    s.guarded([&] { s.put(rows, region); });
    s.next_row = region.y1;
}

void DeepWriter::commit()
{
    State& s = *m_state;
    if (s.next_row != s.desc.data.y1 || !s.file)
        throw OutputError(s.options.path + ": was not written to its end");
    s.guarded([&] {
        // Destroying the output writes its tables, and would swallow an error: ours is remembered.
        s.close();
        if (!s.file->failure().empty()) throw OutputError(s.file->failure());
        s.file->commit();
    });
    s.file.reset();
}

void DeepWriter::abandon() noexcept
{
    if (!m_state) return;
    m_state->close();
    m_state->file.reset();
}

} // namespace rayloom

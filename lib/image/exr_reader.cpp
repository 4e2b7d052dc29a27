// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/exr_reader.h"

#include "rayloom/core/error.h"
#include "rayloom/core/parallel.h"
#include "rayloom/core/text.h"
#include "rayloom/image/deep_rows.h"
#include "rayloom/image/half.h"
#include "rayloom/image/image_input.h"

#include <OpenEXR/openexr_chunkio.h>
#include <OpenEXR/openexr_context.h>
#include <OpenImageIO/deepdata.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <iterator>
#include <limits>
#include <mutex>
#include <thread>

namespace rayloom
{

namespace
{
constexpr std::uint64_t max_deep_bytes = std::uint64_t{1} << 40; // a block that claims more lies
// Decoded rows held at a time: enough for every decoding thread to have blocks of its own.
constexpr std::size_t band_bytes = std::size_t{32} << 20;
} // namespace

// The open file and the rows last decoded.
struct ImageReader::State {
    std::shared_ptr<const ImageFile> file;
    ChannelSelection selection;
    ImageDesc desc;
    const PartInfo* part = nullptr;

    int first_channel = 0, end_channel = 0; ///< decoded range, a superset of the selection
    bool native = false;                    ///< decoded rows hold the file's own types
    std::size_t pixel_bytes = 0;
    struct Source {
        std::size_t offset;
        OIIO::TypeDesc::BASETYPE type;
    };
    std::vector<Source> sources; ///< per selected channel, in a decoded pixel

    std::mutex mutex;
    std::unique_ptr<OIIO::ImageInput> input;
    Region decoded; ///< what `pixels` holds
    std::unique_ptr<std::byte[]> pixels;
    std::size_t capacity = 0;
    int last_row = 0; ///< end of the last region read
    Region deep_decoded;
    std::vector<DeepRow> deep_rows;

    [[noreturn]] void fail_rows(int y0, int y1, std::string why) const
    {
        const std::string of = selection.layer.empty() ? "" : " of '" + selection.layer + "'";
        fail_input(file->path(), "rows " + std::to_string(y0) + " to " + std::to_string(y1 - 1) +
                                     of + " cannot be read (the file is truncated or corrupt): " +
                                     plain_message(std::move(why), file->path()));
    }

    void open()
    {
        if (input) return;
        input = open_input(file->path());
        // The file may have been replaced since its header was read.
        bool same = input->seek_subimage(part->index, 0);
        if (same) {
            const OIIO::ImageSpec spec = input->spec_dimensions(part->index, 0);
            same = spec.x == part->spec->x && spec.y == part->spec->y &&
                   spec.width == part->spec->width && spec.height == part->spec->height &&
                   spec.nchannels == part->spec->nchannels &&
                   spec.channelformats == part->spec->channelformats &&
                   spec.format == part->spec->format;
        }
        if (!same) {
            input.reset();
            fail_input(file->path(), "changed while it was being read");
        }
    }

    std::byte* reserve(std::size_t bytes)
    {
        if (bytes <= capacity) return pixels.get();
        decoded = {};
        pixels.reset();
        capacity = 0;
        pixels.reset(new (std::nothrow) std::byte[bytes]);
        if (!pixels)
            throw MemoryError(file->path() + ": no memory for " + format_bytes(bytes) +
                              " of decoded rows");
        capacity = bytes;
        return pixels.get();
    }

    // Decodes whole rows of blocks; `r` starts and ends on block boundaries or the image's end.
    void decode(const Region& r)
    {
        open();
        std::byte* to = reserve(r.pixels() * pixel_bytes);
        decoded = {};
        const OIIO::ImageSpec& spec = *part->spec;
        bool ok = false;
        std::string why;
        try {
            if (spec.tile_width > 0)
                ok = native ? input->read_native_tiles(part->index, 0, r.x0, r.x1, r.y0, r.y1, 0, 1,
                                                       first_channel, end_channel, to)
                            : input->read_tiles(part->index, 0, r.x0, r.x1, r.y0, r.y1, 0, 1,
                                                first_channel, end_channel, OIIO::TypeFloat, to);
            else
                ok = native ? input->read_native_scanlines(part->index, 0, r.y0, r.y1, 0,
                                                           first_channel, end_channel, to)
                            : input->read_scanlines(part->index, 0, r.y0, r.y1, 0, first_channel,
                                                    end_channel, OIIO::TypeFloat, to);
        } catch (const std::bad_alloc&) {
            throw MemoryError(file->path() + ": no memory to decode rows");
        } catch (const std::exception& e) {
            why = e.what();
        }
        if (!ok) {
            if (why.empty()) why = input->geterror();
            input.reset(); // whatever state the decoder is in, the next try starts anew
            fail_rows(r.y0, std::min(r.y1, part->data.y1), why);
        }
        decoded = r;
    }

    void unpack_row(const ImageView& out, int y) const
    {
        constexpr std::size_t block = 64; // pixels whose decoded bytes stay in the first cache
        const Region& r = out.region();
        const auto width = static_cast<std::size_t>(r.width());
        const std::byte* row = pixels.get() + (static_cast<std::size_t>(y - decoded.y0) *
                                                   static_cast<std::size_t>(decoded.width()) +
                                               static_cast<std::size_t>(r.x0 - decoded.x0)) *
                                                  pixel_bytes;
        std::array<std::uint16_t, block> halves;
        for (std::size_t x = 0; x < width; x += block) {
            const std::size_t n = std::min(block, width - x);
            const std::byte* base = row + x * pixel_bytes;
            for (std::size_t c = 0; c < sources.size(); ++c) {
                const std::byte* from = base + sources[c].offset;
                float* to = out.row(static_cast<int>(c), y) + x;
                switch (sources[c].type) {
                case OIIO::TypeDesc::HALF:
                    for (std::size_t i = 0; i < n; ++i)
                        std::memcpy(&halves[i], from + i * pixel_bytes, sizeof(std::uint16_t));
                    half_to_float(halves.data(), to, n);
                    break;
                case OIIO::TypeDesc::UINT32:
                    for (std::size_t i = 0; i < n; ++i) {
                        std::uint32_t value;
                        std::memcpy(&value, from + i * pixel_bytes, sizeof value);
                        to[i] = static_cast<float>(value);
                    }
                    break;
                default:
                    for (std::size_t i = 0; i < n; ++i)
                        std::memcpy(to + i, from + i * pixel_bytes, sizeof(float));
                }
            }
        }
    }
};

ImageReader::ImageReader(std::shared_ptr<const ImageFile> file, ChannelSelection selection)
    : m_state(std::make_unique<State>())
{
    State& s = *m_state;
    s.file = std::move(file);
    s.selection = std::move(selection);
    s.desc = s.file->desc(s.selection);
    s.part = &s.file->parts()[static_cast<std::size_t>(s.selection.part)];
    const OIIO::ImageSpec& spec = *s.part->spec;
    if (s.selection.channels.empty()) fail_input(s.file->path(), "no channel was selected");
    const auto [low, high] =
        std::minmax_element(s.selection.channels.begin(), s.selection.channels.end());
    s.first_channel = *low;
    s.end_channel = *high + 1;
    s.native = std::string_view(s.file->format()) == "openexr";
    for (int c = s.first_channel; c < s.end_channel; ++c) {
        const auto type = static_cast<OIIO::TypeDesc::BASETYPE>(spec.channelformat(c).basetype);
        s.native = s.native && (type == OIIO::TypeDesc::HALF || type == OIIO::TypeDesc::FLOAT ||
                                type == OIIO::TypeDesc::UINT32);
    }
    std::vector<std::size_t> offsets;
    for (int c = s.first_channel; c < s.end_channel; ++c) {
        offsets.push_back(s.pixel_bytes);
        s.pixel_bytes += s.native ? spec.channelformat(c).size() : sizeof(float);
    }
    for (const int c : s.selection.channels)
        s.sources.push_back(
            {offsets[static_cast<std::size_t>(c - s.first_channel)],
             s.native ? static_cast<OIIO::TypeDesc::BASETYPE>(spec.channelformat(c).basetype)
                      : OIIO::TypeDesc::FLOAT});
}

ImageReader::~ImageReader() = default;
ImageReader::ImageReader(ImageReader&&) noexcept = default;
ImageReader& ImageReader::operator=(ImageReader&&) noexcept = default;

const ImageFile& ImageReader::file() const { return *m_state->file; }
const ChannelSelection& ImageReader::selection() const { return m_state->selection; }
const ImageDesc& ImageReader::desc() const { return m_state->desc; }
const PartInfo& ImageReader::part() const { return *m_state->part; }

void ImageReader::read(ImageView out) const
{
    State& s = *m_state;
    const Region& r = out.region();
    if (r.empty()) return;
    if (!s.desc.data.contains(r) || out.channels() != s.desc.channel_count())
        throw InputError(s.file->path() + ": " + r.text() + " with " +
                         std::to_string(out.channels()) + " channels was asked for; there is " +
                         s.desc.data.text() + " with " + std::to_string(s.desc.channel_count()));
    if (s.part->deep)
        fail_input(s.file->path(),
                   "'" + s.selection.layer + "' is deep; read it with io.read_deep");
    const std::lock_guard lock(s.mutex);
    const OIIO::ImageSpec& spec = *s.part->spec;
    const Region& data = s.part->data;
    const int chunk = s.part->chunk_rows;
    Region columns = data; // scanlines are always decoded whole
    // Tiles of EXR are decoded in place where whole ones are asked for, even beyond the image;
    // the library would otherwise go through a copy.
    const bool whole_tiles = s.native && spec.tile_width > 0;
    if (spec.tile_width > 0) {
        columns.x0 = data.x0 + (r.x0 - data.x0) / spec.tile_width * spec.tile_width;
        columns.x1 =
            data.x0 + (r.x1 - data.x0 + spec.tile_width - 1) / spec.tile_width * spec.tile_width;
        if (!whole_tiles) columns.x1 = std::min(columns.x1, data.x1);
    }
    const std::size_t chunk_bytes =
        static_cast<std::size_t>(columns.width()) * static_cast<std::size_t>(chunk) * s.pixel_bytes;
    const int chunks_at_once =
        static_cast<int>(std::clamp<std::size_t>(band_bytes / chunk_bytes, 2, 1 << 16));
    for (int y = r.y0; y < r.y1;) {
        if (!s.decoded.contains(Region{r.x0, y, r.x1, y + 1})) {
            const int start = data.y0 + (y - data.y0) / chunk * chunk;
            // Whole blocks up to the last row wanted, and at least the one this row is in.
            const std::int64_t want = (std::int64_t{r.y1} - start + chunk - 1) / chunk;
            const std::int64_t n = std::clamp<std::int64_t>(want, 1, chunks_at_once);
            const std::int64_t last = start + n * chunk;
            const auto end =
                static_cast<int>(whole_tiles ? last : std::min<std::int64_t>(data.y1, last));
            s.decode({columns.x0, start, columns.x1, end});
        }
        const int end = std::min(r.y1, s.decoded.y1);
        parallel_for(y, end, 4, [&](int row) { s.unpack_row(out, row); });
        y = end;
    }
    s.last_row = r.y1;
}

DeepRow ImageReader::read_deep_row(int y) const
{
    State& s = *m_state;
    const Region& data = s.part->data;
    if (!s.part->deep) fail_input(s.file->path(), "'" + s.selection.layer + "' is not deep");
    if (y < data.y0 || y >= data.y1)
        throw InputError(s.file->path() + ": there is no row " + std::to_string(y));
    const std::lock_guard lock(s.mutex);
    if (y < s.deep_decoded.y0 || y >= s.deep_decoded.y1) {
        s.open();
        const OIIO::ImageSpec& spec = *s.part->spec;
        const int chunk = s.part->chunk_rows;
        const int start = data.y0 + (y - data.y0) / chunk * chunk;
        const int end =
            static_cast<int>(std::min<std::int64_t>(data.y1, std::int64_t{start} + chunk));
        OIIO::DeepData deep;
        bool ok = false;
        std::string why;
        try {
            ok = spec.tile_width > 0
                     ? s.input->read_native_deep_tiles(s.part->index, 0, data.x0, data.x1, start,
                                                       end, 0, 1, s.first_channel, s.end_channel,
                                                       deep)
                     : s.input->read_native_deep_scanlines(s.part->index, 0, start, end, 0,
                                                           s.first_channel, s.end_channel, deep);
        } catch (const std::bad_alloc&) {
            throw MemoryError(s.file->path() + ": no memory for the deep samples of rows " +
                              std::to_string(start) + " to " + std::to_string(end - 1));
        } catch (const std::exception& e) {
            why = e.what();
        }
        if (!ok) {
            if (why.empty()) why = s.input->geterror();
            s.input.reset();
            s.fail_rows(start, end, why);
        }
        s.deep_rows.clear();
        s.deep_decoded = {};
        const auto width = static_cast<std::size_t>(data.width());
        for (int row = start; row < end; ++row) {
            DeepRow out;
            out.first.resize(width + 1, 0);
            const auto base = static_cast<std::int64_t>(row - start) * data.width();
            std::uint64_t total = 0;
            for (std::size_t i = 0; i < width; ++i) {
                out.first[i] = static_cast<std::uint32_t>(total);
                total += static_cast<std::uint64_t>(
                    std::max(0, deep.samples(base + static_cast<std::int64_t>(i))));
                if (total > std::numeric_limits<std::uint32_t>::max())
                    s.fail_rows(row, row + 1, "more deep samples in a row than there can be");
            }
            out.first[width] = static_cast<std::uint32_t>(total);
            std::vector<std::vector<float>> remainders;
            for (const int c : s.selection.channels) {
                const int dc = c - s.first_channel;
                const bool integer = deep.channeltype(dc).basetype == OIIO::TypeDesc::UINT32;
                if (integer) {
                    std::vector<std::uint32_t> ids;
                    ids.reserve(total);
                    for (std::size_t i = 0; i < width; ++i) {
                        const std::int64_t p = base + static_cast<std::int64_t>(i);
                        for (int k = 0; k < deep.samples(p); ++k)
                            ids.push_back(deep.deep_value_uint(p, dc, k));
                    }
                    add_id_channel(out, ids, remainders);
                    continue;
                }
                std::vector<float> values;
                values.reserve(total);
                for (std::size_t i = 0; i < width; ++i) {
                    const std::int64_t p = base + static_cast<std::int64_t>(i);
                    for (int k = 0; k < deep.samples(p); ++k)
                        values.push_back(deep.deep_value(p, dc, k));
                }
                out.samples.push_back(std::move(values));
            }
            std::ranges::move(remainders, std::back_inserter(out.samples));
            s.deep_rows.push_back(std::move(out));
        }
        s.deep_decoded = {data.x0, start, data.x1, end};
    }
    return s.deep_rows[static_cast<std::size_t>(y - s.deep_decoded.y0)];
}

std::size_t ImageReader::deep_row_samples() const
{
    const State& s = *m_state;
    const OIIO::ImageSpec& spec = *s.part->spec;
    std::uint64_t sample_bytes = 0;
    for (int c = 0; c < spec.nchannels; ++c) sample_bytes += spec.channelformat(c).size();
    exr_context_initializer_t settings = EXR_DEFAULT_CONTEXT_INITIALIZER;
    settings.error_handler_fn = [](exr_const_context_t, exr_result_t, const char*) {};
    exr_context_t context = nullptr;
    if (exr_start_read(&context, s.file->path().c_str(), &settings) != EXR_ERR_SUCCESS) return 0;
    const Region& data = s.part->data;
    const int chunk = s.part->chunk_rows;
    const int across =
        spec.tile_width > 0 ? (data.width() + spec.tile_width - 1) / spec.tile_width : 0;
    std::uint64_t most = 0;
    for (int block = 0; block * chunk < data.height(); ++block) {
        exr_chunk_info_t info{};
        std::uint64_t bytes = 0;
        const auto add = [&](exr_result_t result) {
            if (result == EXR_ERR_SUCCESS) bytes += std::min(info.unpacked_size, max_deep_bytes);
        };
        if (across == 0)
            add(exr_read_scanline_chunk_info(context, s.part->index, data.y0 + block * chunk,
                                             &info));
        for (int tile = 0; tile < across; ++tile)
            add(exr_read_tile_chunk_info(context, s.part->index, tile, block, 0, 0, &info));
        const int rows = std::min(chunk, data.height() - block * chunk);
        most = std::max(most, bytes / sample_bytes / static_cast<std::uint64_t>(rows));
    }
    exr_finish(&context);
    return most;
}

std::size_t ImageReader::scratch_bytes() const
{
    const State& s = *m_state;
    const auto row = static_cast<std::size_t>(s.part->data.width()) * s.pixel_bytes;
    return std::min(row * static_cast<std::size_t>(s.part->data.height()),
                    std::max(band_bytes, 2 * row * static_cast<std::size_t>(s.part->chunk_rows)));
}

void ImageReader::trim() const
{
    State& s = *m_state;
    const std::lock_guard lock(s.mutex);
    if (s.last_row < std::min(s.decoded.y1, s.part->data.y1)) return;
    s.pixels.reset();
    s.capacity = 0;
    s.decoded = {};
}

void ImageReader::release() const
{
    State& s = *m_state;
    const std::lock_guard lock(s.mutex);
    s.input.reset();
    s.pixels.reset();
    s.capacity = 0;
    s.decoded = s.deep_decoded = {};
    s.deep_rows.clear();
}

void set_image_threads(int threads)
{
    // What OpenImageIO's pool loses in threads it detaches without giving back their stacks: runs
    // on many and on few threads in turn would use up the address space. So that pool only grows.
    // It has little to do: OpenEXR has threads of its own.
    static std::mutex mutex;
    static int largest = 0;
    const std::lock_guard lock(mutex);
    const int wanted =
        threads > 0 ? threads : static_cast<int>(std::thread::hardware_concurrency());
    if (wanted > largest) {
        OIIO::attribute("threads", wanted);
        largest = wanted;
    }
    // The plug-in reads 0 as "every processor" and −1 as "no pool at all".
    OIIO::attribute("exr_threads", threads == 1 ? -1 : threads);
}

} // namespace rayloom

// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/exr_reader.h"

#include "rayloom/core/error.h"
#include "rayloom/core/parallel.h"
#include "rayloom/core/text.h"
#include "rayloom/image/deep_rows.h"
#include "rayloom/image/half.h"
#include "rayloom/image/image_input.h"
#include "rayloom/image/row_decoder.h"

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
} // namespace

struct ImageReader::State {
    std::shared_ptr<const ImageFile> file;
    ChannelSelection selection;
    ImageDesc desc;
    const PartInfo* part = nullptr;
    std::shared_ptr<RowDecoder> decoder; ///< its own, or that of all readers it shares rows with
    std::vector<RowDecoder::Channel> sources; ///< per selected channel, in a decoded pixel
    Region deep_decoded;
    std::vector<DeepRow> deep_rows;
    std::size_t rows_decoded = 0; ///< guarded by the lock of the decoder

    std::pair<int, int> channel_range() const
    {
        const auto [low, high] = std::ranges::minmax_element(selection.channels);
        return {*low, *high + 1};
    }

    void use(std::shared_ptr<RowDecoder> rows)
    {
        if (decoder) decoder->leave(this);
        decoder = std::move(rows);
        decoder->join(this);
        sources.clear();
        for (const int c : selection.channels) sources.push_back(decoder->channel(c));
    }

    void unpack_row(const ImageView& out, int y) const
    {
        constexpr std::size_t block = 64; // pixels whose decoded bytes stay in the first cache
        const Region& r = out.region();
        const auto width = static_cast<std::size_t>(r.width());
        const std::byte* row = decoder->pixel(r.x0, y);
        const std::size_t pixel_bytes = decoder->pixel_bytes();
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
    if (s.selection.channels.empty()) fail_input(s.file->path(), "no channel was selected");
    const auto [first, end] = s.channel_range();
    s.use(std::make_shared<RowDecoder>(s.file, s.selection.part, first, end));
}

ImageReader::~ImageReader()
{
    if (m_state) m_state->decoder->leave(m_state.get());
}
ImageReader::ImageReader(ImageReader&&) noexcept = default;
ImageReader& ImageReader::operator=(ImageReader&& other) noexcept
{
    std::swap(m_state, other.m_state); // the other one's end is this one's
    return *this;
}

bool ImageReader::may_share(const ImageReader& other) const
{
    const State &a = *m_state, &b = *other.m_state;
    return a.file->path() == b.file->path() && a.selection.part == b.selection.part &&
           !a.part->deep && !b.part->deep && same_layout(*a.part->spec, *b.part->spec);
}

std::pair<int, int> ImageReader::channel_range(std::span<const ImageReader* const> readers)
{
    auto [first, end] = readers.front()->m_state->channel_range();
    for (const ImageReader* reader : readers) {
        const auto [from, to] = reader->m_state->channel_range();
        first = std::min(first, from);
        end = std::max(end, to);
    }
    return {first, end};
}

void ImageReader::share_rows(std::span<const ImageReader* const> readers)
{
    if (readers.empty()) return;
    const State& any = *readers.front()->m_state;
    if (any.decoder->readers() == readers.size() &&
        std::ranges::all_of(readers, [&](const ImageReader* reader) {
            return reader->m_state->decoder == any.decoder;
        })) {
        any.decoder->expect_readers();
        return;
    }
    const auto [first, end] = channel_range(readers);
    const auto rows = std::make_shared<RowDecoder>(any.file, any.selection.part, first, end);
    for (const ImageReader* reader : readers) reader->m_state->use(rows);
}

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
    const auto lock = s.decoder->lock();
    for (int y = r.y0; y < r.y1;) {
        const std::size_t before = s.decoder->rows_decoded();
        const int end = std::min(r.y1, s.decoder->decode(r, y, s.selection.layer).y1);
        s.rows_decoded += s.decoder->rows_decoded() - before;
        parallel_for(y, end, 4, [&](int row) { s.unpack_row(out, row); });
        y = end;
    }
    s.decoder->read_up_to(&s, r.y1);
}

DeepRow ImageReader::read_deep_row(int y) const
{
    State& s = *m_state;
    const Region& data = s.part->data;
    if (!s.part->deep) fail_input(s.file->path(), "'" + s.selection.layer + "' is not deep");
    if (y < data.y0 || y >= data.y1)
        throw InputError(s.file->path() + ": there is no row " + std::to_string(y));
    const auto lock = s.decoder->lock();
    if (y < s.deep_decoded.y0 || y >= s.deep_decoded.y1) {
        OIIO::ImageInput& input = s.decoder->input();
        const int first_channel = s.decoder->first(), end_channel = s.decoder->end();
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
                     ? input.read_native_deep_tiles(s.part->index, 0, data.x0, data.x1, start, end,
                                                    0, 1, first_channel, end_channel, deep)
                     : input.read_native_deep_scanlines(s.part->index, 0, start, end, 0,
                                                        first_channel, end_channel, deep);
        } catch (const std::bad_alloc&) {
            throw MemoryError(s.file->path() + ": no memory for the deep samples of rows " +
                              std::to_string(start) + " to " + std::to_string(end - 1));
        } catch (const std::exception& e) {
            why = e.what();
        }
        if (!ok) {
            if (why.empty()) why = input.geterror();
            s.decoder->close();
            s.decoder->fail_rows(start, end, s.selection.layer, why);
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
                    s.decoder->fail_rows(row, row + 1, s.selection.layer,
                                         "more deep samples in a row than there can be");
            }
            out.first[width] = static_cast<std::uint32_t>(total);
            std::vector<std::vector<float>> remainders;
            for (const int c : s.selection.channels) {
                const int dc = c - first_channel;
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

void ImageReader::rows_end() const { m_state->decoder->rows_end(); }

int ImageReader::rows_at_once() const { return m_state->decoder->rows_at_once(); }

std::size_t ImageReader::rows_decoded() const
{
    const auto lock = m_state->decoder->lock();
    return m_state->rows_decoded;
}

std::size_t ImageReader::scratch_bytes() const
{
    const auto [first, end] = m_state->channel_range();
    return RowDecoder::most_bytes(*m_state->part, first, end, 1);
}

std::size_t ImageReader::shared_bytes(std::span<const ImageReader* const> readers)
{
    const auto [first, end] = channel_range(readers);
    return RowDecoder::most_bytes(readers.front()->part(), first, end, readers.size());
}

void ImageReader::trim() const { m_state->decoder->trim(); }

void ImageReader::release() const
{
    State& s = *m_state;
    s.decoder->release(&s);
    const auto lock = s.decoder->lock();
    s.deep_decoded = {};
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

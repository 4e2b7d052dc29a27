// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/exr_reader.h"

#include "rayloom/core/error.h"
#include "rayloom/core/parallel.h"
#include "rayloom/core/text.h"
#include "rayloom/image/half.h"

#include <OpenImageIO/deepdata.h>
#include <OpenImageIO/hash.h>
#include <OpenImageIO/strutil.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <limits>
#include <mutex>
#include <set>
#include <sys/stat.h>
#include <system_error>

namespace rayloom
{

namespace
{
constexpr int max_parts = 4096;
constexpr int max_channels = 16384;
constexpr std::int64_t max_side = 1 << 24;
// Decoded rows held at a time: enough for every decoding thread to have blocks of its own.
constexpr std::size_t band_bytes = std::size_t{32} << 20;

[[noreturn]] void fail(const std::string& path, const std::string& what)
{
    throw InputError(path + ": " + what);
}

// OpenImageIO's messages may hold several lines and the path we already say.
std::string clean(std::string message, const std::string& path)
{
    message = OIIO::Strutil::replace(message, "\"" + path + "\"", "it", true);
    while (!message.empty() && (message.back() == '\n' || message.back() == ' '))
        message.pop_back();
    message = OIIO::Strutil::replace(message, "\n", "; ", true);
    return message.empty() ? "no reason was given" : message;
}

struct stat file_status(const std::string& path)
{
    struct stat status {
    };
    if (::stat(path.c_str(), &status) != 0) fail(path, std::strerror(errno));
    if (S_ISDIR(status.st_mode)) fail(path, "is a folder, not an image");
    return status;
}

std::unique_ptr<OIIO::ImageInput> open_input(const std::string& path)
{
    file_status(path);
    if (!std::ifstream(path, std::ios::binary)) fail(path, "cannot be opened for reading");
    std::unique_ptr<OIIO::ImageInput> input;
    try {
        input = OIIO::ImageInput::open(path);
    } catch (const std::system_error& e) {
        if (e.code() == std::errc::resource_unavailable_try_again)
            throw MemoryError(path + ": memory ran out: no thread could be started to read it");
        fail(path, "is not an image that can be read: " + clean(e.what(), path));
    } catch (const std::exception& e) {
        fail(path, "is not an image that can be read: " + clean(e.what(), path));
    }
    if (!input) fail(path, "is not an image that can be read: " + clean(OIIO::geterror(), path));
    return input;
}

int rows_per_chunk(const OIIO::ImageSpec& spec, bool exr)
{
    if (spec.tile_height > 0) return spec.tile_height;
    if (!exr) return std::max(1, spec.get_int_attribute("tiff:RowsPerStrip", 1));
    const std::string compression = spec.get_string_attribute("compression");
    if (OIIO::Strutil::istarts_with(compression, "dwab")) return 256;
    for (const char* name : {"piz", "b44", "dwaa"})
        if (OIIO::Strutil::istarts_with(compression, name)) return 32;
    if (compression == "zip" || compression == "pxr24") return 16;
    return 1;
}

// Refuses headers whose numbers cannot be true before memory is asked for them.
void check_header(const std::string& path, const OIIO::ImageSpec& spec, const PartInfo& part,
                  bool exr, std::int64_t file_bytes)
{
    const std::string size = std::to_string(spec.width) + "x" + std::to_string(spec.height) +
                             " pixels with " + std::to_string(spec.nchannels) + " channels";
    const std::int64_t x1 = std::int64_t{spec.x} + spec.width,
                       y1 = std::int64_t{spec.y} + spec.height,
                       full_x1 = std::int64_t{spec.full_x} + spec.full_width,
                       full_y1 = std::int64_t{spec.full_y} + spec.full_height;
    constexpr std::int64_t edge = std::numeric_limits<int>::max() / 2;
    if (spec.width <= 0 || spec.height <= 0 || spec.nchannels <= 0)
        fail(path, "its header promises " + size + "; the file is corrupt");
    if (spec.depth > 1) fail(path, "is a volume; only flat and deep images are read");
    if (spec.width > max_side || spec.height > max_side || spec.nchannels > max_channels ||
        x1 > edge || y1 > edge || full_x1 > edge || full_y1 > edge || spec.x < -edge ||
        spec.y < -edge || spec.full_x < -edge || spec.full_y < -edge)
        fail(path,
             "its header promises " + size + ", more than any image has; the file is corrupt");
    if (exr) { // every block or tile has an 8-byte entry in the file's table
        const std::int64_t across =
            spec.tile_width > 0 ? (spec.width + spec.tile_width - 1) / spec.tile_width : 1;
        const std::int64_t blocks = (spec.height + part.chunk_rows - 1) / part.chunk_rows * across;
        if (blocks * 8 > file_bytes)
            fail(path, "its header promises " + size + ", but the file has only " +
                           format_bytes(static_cast<std::size_t>(file_bytes)));
    }
}

std::vector<std::string> view_names(const OIIO::ImageSpec& spec)
{
    std::vector<std::string> views;
    const OIIO::ParamValue* p = spec.find_attribute("multiView");
    if (p != nullptr && p->type().basetype == OIIO::TypeDesc::STRING)
        for (int i = 0; i < p->nvalues() * static_cast<int>(p->type().numelements()); ++i)
            views.push_back(p->get_string_indexed(i));
    return views;
}

void add_layers(const PartInfo& part, const std::vector<std::string>& views,
                std::vector<LayerInfo>& layers)
{
    const std::size_t first = layers.size();
    for (int c = 0; c < part.spec->nchannels; ++c) {
        const std::string& full = part.spec->channelnames[static_cast<std::size_t>(c)];
        const std::size_t dot = full.rfind('.');
        const std::string prefix = dot == std::string::npos ? "" : full.substr(0, dot);
        auto layer = std::find_if(layers.begin() + static_cast<std::ptrdiff_t>(first), layers.end(),
                                  [&](const LayerInfo& l) { return l.name == prefix; });
        if (layer == layers.end()) {
            LayerInfo info;
            info.part = part.index;
            info.part_name = part.name;
            info.name = prefix;
            info.view = part.view;
            std::string rest = prefix;
            std::string last = rest.substr(rest.rfind('.') + 1);
            if (std::find(views.begin(), views.end(), last) != views.end()) {
                info.view = last;
                rest.resize(rest.size() - std::min(rest.size(), last.size() + 1));
                last = rest.substr(rest.rfind('.') + 1);
            } else if (!views.empty()) {
                info.view = views.front(); // names without a view belong to the first one
            }
            info.pass = last;
            layers.push_back(std::move(info));
            layer = layers.end() - 1;
        }
        layer->channels.push_back(c);
        layer->channel_names.push_back(dot == std::string::npos ? full : full.substr(dot + 1));
    }
}
} // namespace

std::string LayerInfo::address() const
{
    if (name.empty() || part_name.empty()) return name.empty() ? part_name : name;
    if (name == part_name || OIIO::Strutil::starts_with(name, part_name + ".")) return name;
    return part_name + "." + name;
}

std::vector<std::string> LayerInfo::full_names() const
{
    std::vector<std::string> names;
    for (const std::string& c : channel_names) names.push_back(name.empty() ? c : name + "." + c);
    return names;
}

std::shared_ptr<const ImageFile> ImageFile::open(const std::string& path)
{
    const auto input = open_input(path);
    const std::int64_t file_bytes = file_status(path).st_size;
    auto file = std::make_shared<ImageFile>();
    file->m_path = path;
    file->m_format = input->format_name();
    const bool exr = file->m_format == "openexr";
    for (int i = 0; i < max_parts && input->seek_subimage(i, 0); ++i) {
        const auto spec = std::make_shared<const OIIO::ImageSpec>(input->spec());
        PartInfo part;
        part.index = i;
        part.name =
            spec->get_string_attribute("oiio:subimagename", spec->get_string_attribute("name"));
        part.view = spec->get_string_attribute("view");
        part.spec = spec;
        part.deep = spec->deep;
        part.chunk_rows = rows_per_chunk(*spec, exr);
        check_header(path, *spec, part, exr, file_bytes);
        part.data = {spec->x, spec->y, spec->x + spec->width, spec->y + spec->height};
        part.display = {spec->full_x, spec->full_y, spec->full_x + spec->full_width,
                        spec->full_y + spec->full_height};
        file->m_parts.push_back(std::move(part));
    }
    if (file->m_parts.empty()) fail(path, "holds no image");
    for (PartInfo& part : file->m_parts) {
        if (part.name.empty() && file->m_parts.size() > 1) part.name = std::to_string(part.index);
        add_layers(part, view_names(*part.spec), file->m_layers);
    }
    return file;
}

namespace
{
bool same_text(std::string_view a, std::string_view b, bool ignore_case)
{
    return ignore_case ? OIIO::Strutil::iequals({a.data(), a.size()}, {b.data(), b.size()})
                       : a == b;
}

ChannelSelection whole_layer(const LayerInfo& layer)
{
    return {layer.part, layer.address(), layer.channels, layer.channel_names};
}

// All of a part's channels under `prefix`, named by what follows it.
ChannelSelection channels_under(const PartInfo& part, const std::string& address,
                                const std::string& prefix)
{
    ChannelSelection s{part.index, address, {}, {}};
    for (int c = 0; c < part.spec->nchannels; ++c) {
        const std::string& full = part.spec->channelnames[static_cast<std::size_t>(c)];
        if (!OIIO::Strutil::starts_with(full, prefix)) continue;
        s.channels.push_back(c);
        s.names.push_back(full.substr(prefix.size()));
    }
    return s;
}
} // namespace

ChannelSelection ImageFile::select(std::string_view address, std::string_view part_text) const
{
    std::vector<int> wanted_parts;
    for (const PartInfo& part : m_parts)
        if (part_text.empty() || part.name == part_text || std::to_string(part.index) == part_text)
            wanted_parts.push_back(part.index);
    if (wanted_parts.empty()) {
        std::vector<std::string> names;
        for (const PartInfo& part : m_parts)
            names.push_back(part.name.empty() ? std::to_string(part.index) : part.name);
        fail(m_path, "has no part '" + std::string(part_text) + "'" + suggestion(part_text, names));
    }
    // A number may be one part's name and another's place; the name wins.
    for (const int p : std::vector<int>(wanted_parts))
        if (!part_text.empty() && m_parts[static_cast<std::size_t>(p)].name == part_text)
            wanted_parts = {p};

    std::vector<const LayerInfo*> candidates;
    for (const LayerInfo& layer : m_layers)
        if (std::find(wanted_parts.begin(), wanted_parts.end(), layer.part) != wanted_parts.end())
            candidates.push_back(&layer);
    const std::string text(address);

    if (text.empty()) {
        const PartInfo& first = m_parts[static_cast<std::size_t>(wanted_parts.front())];
        std::vector<const LayerInfo*> here;
        for (const LayerInfo* l : candidates)
            if (l->part == first.index) here.push_back(l);
        if (here.size() == 1) return whole_layer(*here.front());
        return channels_under(first, first.name, "");
    }

    std::vector<ChannelSelection> found;
    const auto settled = [&]() -> bool {
        if (found.size() <= 1) return !found.empty();
        std::vector<std::string> names;
        for (const ChannelSelection& s : found) names.push_back(s.layer);
        fail(m_path,
             "'" + text + "' may be " + join_names(names, true) + "; write which of them is meant");
    };
    for (const bool ignore_case : {false, true}) {
        const auto equal = [&](const std::string& name) {
            return same_text(name, text, ignore_case);
        };
        // A layer's full address, its name, or the part that has this one plain layer.
        for (const LayerInfo* l : candidates)
            if (equal(l->address()) ||
                (!l->part_name.empty() && !l->name.empty() && equal(l->part_name + "." + l->name)))
                found.push_back(whole_layer(*l));
        if (settled()) return found.front();
        for (const LayerInfo* l : candidates)
            if (!l->name.empty() && equal(l->name)) found.push_back(whole_layer(*l));
        if (settled()) return found.front();
        for (const LayerInfo* l : candidates)
            if (!l->pass.empty() && (equal(l->pass) || equal(l->pass + "." + l->view)))
                found.push_back(whole_layer(*l));
        if (settled()) return found.front();
        // One channel.
        for (const LayerInfo* l : candidates)
            for (std::size_t c = 0; c < l->channels.size(); ++c) {
                const std::string full =
                    l->name.empty() ? l->channel_names[c] : l->name + "." + l->channel_names[c];
                if (equal(full) || (!l->part_name.empty() && equal(l->part_name + "." + full)) ||
                    (!l->name.empty() && equal(l->pass + "." + l->channel_names[c])))
                    found.push_back({l->part,
                                     l->part_name.empty() ? full : l->part_name + "." + full,
                                     {l->channels[c]},
                                     {l->channel_names[c]}});
            }
        if (settled()) return found.front();
    }
    // The common beginning of several layers, or a part with several.
    for (const int p : wanted_parts) {
        const PartInfo& part = m_parts[static_cast<std::size_t>(p)];
        ChannelSelection under = channels_under(part, text, text + ".");
        if (!under.channels.empty())
            found.push_back(std::move(under));
        else if (!part.name.empty() && part.name == text)
            found.push_back(channels_under(part, text, ""));
        else if (!part.name.empty() && OIIO::Strutil::starts_with(text, part.name + ".")) {
            under = channels_under(part, text, text.substr(part.name.size() + 1) + ".");
            if (!under.channels.empty()) found.push_back(std::move(under));
        }
    }
    if (found.size() > 1)
        for (ChannelSelection& s : found)
            s.layer = m_parts[static_cast<std::size_t>(s.part)].name + "." + text;
    if (settled()) return found.front();

    std::set<std::string> names;
    for (const LayerInfo* l : candidates) {
        if (l->address().empty())
            names.insert(l->channel_names.begin(), l->channel_names.end());
        else
            names.insert(l->address());
    }
    const std::vector<std::string> all(names.begin(), names.end());
    std::string hint = suggestion(text, all);
    if (hint.empty()) hint = "; 'rayloom info' lists its " + std::to_string(all.size()) + " layers";
    fail(m_path, "has no layer '" + text + "'" + hint);
}

ChannelSelection ImageFile::narrow(ChannelSelection s, std::string_view channels) const
{
    if (channels.empty() || channels == "any") return s;
    const auto index_of = [&](std::string_view name) {
        const auto it = std::find(s.names.begin(), s.names.end(), name);
        return it == s.names.end() ? -1 : static_cast<int>(it - s.names.begin());
    };
    std::vector<int> wanted;
    if (channels == "RGB") {
        using Triple = std::array<const char*, 3>;
        for (const Triple& names :
             {Triple{"R", "G", "B"}, Triple{"r", "g", "b"}, Triple{"red", "green", "blue"},
              Triple{"X", "Y", "Z"}, Triple{"x", "y", "z"}}) {
            std::vector<int> three;
            for (const char* name : names)
                if (const int i = index_of(name); i >= 0) three.push_back(i);
            if (three.size() == 3 && wanted.empty()) wanted = three;
        }
        int alpha = -1;
        for (const char* name : {"A", "a", "alpha"})
            if (alpha < 0) alpha = index_of(name);
        if (wanted.empty()) // a grey image is its own colour
            for (int i = 0; i < static_cast<int>(s.names.size()); ++i)
                if (i != alpha) wanted.push_back(i);
        if (wanted.size() != 3 && wanted.size() != 1)
            fail(m_path, (s.layer.empty() ? std::string("it") : "layer '" + s.layer + "'") +
                             " has no channels R, G and B; it has " +
                             (s.names.size() <= 24 ? join_names(s.names)
                                                   : std::to_string(s.names.size()) + " others") +
                             "; name a layer");
        if (alpha >= 0) wanted.push_back(alpha);
    } else {
        for (const std::string& piece :
             OIIO::Strutil::splits({channels.data(), channels.size()}, ",")) {
            const std::string name(OIIO::Strutil::strip(piece));
            const int i = index_of(name);
            if (i < 0)
                fail(m_path, (s.layer.empty() ? std::string("it") : "layer '" + s.layer + "'") +
                                 " has no channel '" + name + "'" + suggestion(name, s.names));
            wanted.push_back(i);
        }
    }
    ChannelSelection out{s.part, s.layer, {}, {}};
    for (const int i : wanted) {
        out.channels.push_back(s.channels[static_cast<std::size_t>(i)]);
        out.names.push_back(s.names[static_cast<std::size_t>(i)]);
    }
    return out;
}

ImageDesc ImageFile::desc(const ChannelSelection& s) const
{
    const PartInfo& part = m_parts[static_cast<std::size_t>(s.part)];
    auto header = std::make_shared<OIIO::ImageSpec>(*part.spec);
    header->nchannels = static_cast<int>(s.channels.size());
    header->channelnames = s.names;
    header->channelformats.clear();
    header->alpha_channel = header->z_channel = -1;
    bool mixed = false;
    for (std::size_t i = 0; i < s.channels.size(); ++i) {
        const OIIO::TypeDesc type = part.spec->channelformat(s.channels[i]);
        header->channelformats.push_back(type);
        mixed = mixed || type != header->channelformats.front();
        if (s.names[i] == "A") header->alpha_channel = static_cast<int>(i);
        if (s.names[i] == "Z") header->z_channel = static_cast<int>(i);
    }
    if (!header->channelformats.empty()) header->format = header->channelformats.front();
    if (!mixed) header->channelformats.clear();
    ImageDesc desc;
    desc.data = part.data;
    desc.display = part.display;
    desc.channels = s.names;
    desc.header = std::move(header);
    return desc;
}

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
        fail(file->path(), "rows " + std::to_string(y0) + " to " + std::to_string(y1 - 1) + of +
                               " cannot be read (the file is truncated or corrupt): " +
                               clean(std::move(why), file->path()));
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
            fail(file->path(), "changed while it was being read");
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
    if (s.selection.channels.empty()) fail(s.file->path(), "no channel was selected");
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
        fail(s.file->path(), "'" + s.selection.layer + "' is deep; read it with io.read_deep");
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
    if (!s.part->deep) fail(s.file->path(), "'" + s.selection.layer + "' is not deep");
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
            for (const int c : s.selection.channels) {
                const int dc = c - s.first_channel;
                const bool integer = deep.channeltype(dc).basetype == OIIO::TypeDesc::UINT32;
                std::vector<float> values;
                values.reserve(total);
                for (std::size_t i = 0; i < width; ++i) {
                    const std::int64_t p = base + static_cast<std::int64_t>(i);
                    for (int k = 0; k < deep.samples(p); ++k)
                        values.push_back(integer
                                             ? static_cast<float>(deep.deep_value_uint(p, dc, k))
                                             : deep.deep_value(p, dc, k));
                }
                out.samples.push_back(std::move(values));
            }
            s.deep_rows.push_back(std::move(out));
        }
        s.deep_decoded = {data.x0, start, data.x1, end};
    }
    return s.deep_rows[static_cast<std::size_t>(y - s.deep_decoded.y0)];
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
    OIIO::attribute("threads", threads);
    // The plug-in reads 0 as "every processor" and −1 as "no pool at all".
    OIIO::attribute("exr_threads", threads == 1 ? -1 : threads);
}

std::string file_content_key(const std::string& path, bool thorough)
{
    const struct stat status = file_status(path);
    if (!thorough)
        return path + "|" + std::to_string(status.st_size) + "|" +
               std::to_string(status.st_mtim.tv_sec) + "." + std::to_string(status.st_mtim.tv_nsec);
    std::ifstream in(path, std::ios::binary);
    if (!in) fail(path, "cannot be opened for reading");
    std::vector<char> block(std::size_t{4} << 20);
    std::uint64_t hash = static_cast<std::uint64_t>(status.st_size);
    while (in) {
        in.read(block.data(), static_cast<std::streamsize>(block.size()));
        hash = OIIO::xxhash::xxhash(block.data(), static_cast<std::size_t>(in.gcount()), hash);
    }
    if (in.bad()) fail(path, "cannot be read to its end");
    return OIIO::Strutil::sprintf("%016llx", static_cast<unsigned long long>(hash));
}

} // namespace rayloom

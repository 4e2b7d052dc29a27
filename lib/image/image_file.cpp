// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/image_file.h"

#include "rayloom/core/text.h"
#include "rayloom/image/image_input.h"

#include <OpenImageIO/hash.h>
#include <OpenImageIO/strutil.h>

#include <algorithm>
#include <fstream>
#include <limits>

namespace rayloom
{

namespace
{
constexpr int max_parts = 4096;
constexpr int max_channels = 16384;
constexpr std::int64_t max_side = 1 << 24;

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
        fail_input(path, "its header promises " + size + "; the file is corrupt");
    if (spec.depth > 1) fail_input(path, "is a volume; only flat and deep images are read");
    if (spec.width > max_side || spec.height > max_side || spec.nchannels > max_channels ||
        x1 > edge || y1 > edge || full_x1 > edge || full_y1 > edge || spec.x < -edge ||
        spec.y < -edge || spec.full_x < -edge || spec.full_y < -edge)
        fail_input(path, "its header promises " + size +
                             ", more than any image has; the file is corrupt");
    if (exr) { // every block or tile has an 8-byte entry in the file's table
        const std::int64_t across =
            spec.tile_width > 0 ? (spec.width + spec.tile_width - 1) / spec.tile_width : 1;
        const std::int64_t blocks = (spec.height + part.chunk_rows - 1) / part.chunk_rows * across;
        if (blocks * 8 > file_bytes)
            fail_input(path, "its header promises " + size + ", but the file has only " +
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
        const auto spec = std::make_shared<OIIO::ImageSpec>(input->spec());
        // FITS has more channels than names.
        if (std::ssize(spec->channelnames) != spec->nchannels) spec->default_channel_names();
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
    if (file->m_parts.empty()) fail_input(path, "holds no image");
    for (PartInfo& part : file->m_parts) {
        if (part.name.empty() && file->m_parts.size() > 1) part.name = std::to_string(part.index);
        add_layers(part, view_names(*part.spec), file->m_layers);
    }
    return file;
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

std::string file_content_key(const std::string& path, bool thorough)
{
    const struct stat status = file_status(path);
    if (!thorough)
        return path + "|" + std::to_string(status.st_size) + "|" +
               std::to_string(status.st_mtim.tv_sec) + "." + std::to_string(status.st_mtim.tv_nsec);
    std::ifstream in(path, std::ios::binary);
    if (!in) fail_input(path, "cannot be opened for reading");
    std::vector<char> block(std::size_t{4} << 20);
    std::uint64_t hash = static_cast<std::uint64_t>(status.st_size);
    while (in) {
        in.read(block.data(), static_cast<std::streamsize>(block.size()));
        hash = OIIO::xxhash::xxhash(block.data(), static_cast<std::size_t>(in.gcount()), hash);
    }
    if (in.bad()) fail_input(path, "cannot be read to its end");
    return OIIO::Strutil::sprintf("%016llx", static_cast<unsigned long long>(hash));
}

} // namespace rayloom

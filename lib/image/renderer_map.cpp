// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/renderer_map.h"

#include "rayloom/core/error.h"
#include "rayloom/core/install_paths.h"
#include "rayloom/core/text.h"

#include <OpenImageIO/strutil.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

namespace rayloom
{

namespace
{
constexpr std::string_view plain = "(plain)";

// `*` matches any run of characters.
bool matches(std::string_view pattern, std::string_view text)
{
    std::size_t p = 0, t = 0, star = std::string_view::npos, resume = 0;
    while (t < text.size()) {
        if (p < pattern.size() && pattern[p] == '*') {
            star = p++;
            resume = t;
        } else if (p < pattern.size() && pattern[p] == text[t]) {
            ++p;
            ++t;
        } else if (star != std::string_view::npos) {
            p = star + 1;
            t = ++resume;
        } else {
            return false;
        }
    }
    while (p < pattern.size() && pattern[p] == '*') ++p;
    return p == pattern.size();
}

ChannelSelection whole(const LayerInfo& layer)
{
    return {layer.part, layer.address(), layer.channels, layer.channel_names};
}

// What of a layer a pattern means: all of it, one channel, or nothing.
std::optional<ChannelSelection> match_layer(const std::string& pattern, const LayerInfo& layer)
{
    if (pattern == plain) {
        const ImageDesc names{{}, {}, layer.channel_names, nullptr};
        if (layer.name.empty() && names.colour().size() >= 3) return whole(layer);
        return std::nullopt;
    }
    if ((!layer.name.empty() || !layer.part_name.empty()) &&
        (matches(pattern, layer.address()) ||
         (!layer.name.empty() && matches(pattern, layer.name)) ||
         (!layer.pass.empty() && matches(pattern, layer.pass))))
        return whole(layer);
    const std::vector<std::string> full = layer.full_names();
    for (std::size_t i = 0; i < full.size(); ++i)
        if (matches(pattern, full[i])) {
            // Channels like "Bin_0000" come in numbers: a `*` takes all of them.
            ChannelSelection s{layer.part, full[i], {}, {}};
            for (std::size_t k = i; k < full.size(); ++k)
                if (matches(pattern, full[k])) {
                    s.channels.push_back(layer.channels[k]);
                    s.names.push_back(layer.channel_names[k]);
                }
            if (s.channels.size() > 1) s.layer = pattern;
            return s;
        }
    return std::nullopt;
}

class MapReader
{
public:
    explicit MapReader(std::string file) : m_file(std::move(file)) {}

    void complain(const YAML::Mark& mark, const std::string& message)
    {
        m_problems.push_back({{m_file, mark.line + 1, mark.column + 1}, message});
    }
    std::vector<std::string> texts(const YAML::Node& node, const std::string& what)
    {
        std::vector<std::string> out;
        if (node.IsScalar()) {
            out.push_back(node.Scalar());
        } else if (node.IsSequence()) {
            for (const YAML::Node& item : node) {
                if (item.IsScalar())
                    out.push_back(item.Scalar());
                else
                    complain(item.Mark(), what + " must be texts");
            }
        } else {
            complain(node.Mark(), what + " must be a text or a list of texts");
        }
        if (out.empty()) complain(node.Mark(), what + " is empty");
        return out;
    }
    void keys(const YAML::Node& map, const std::vector<std::string>& known, const std::string& what)
    {
        std::set<std::string> seen;
        for (const auto& entry : map) {
            if (!entry.first.IsScalar()) {
                complain(entry.first.Mark(), "a key must be a text");
                continue;
            }
            const std::string key = entry.first.Scalar();
            if (!seen.insert(key).second)
                complain(entry.first.Mark(), "'" + key + "' is there twice");
            if (std::find(known.begin(), known.end(), key) == known.end())
                complain(entry.first.Mark(),
                         what + " has no '" + key + "'" + suggestion(key, known));
        }
    }
    bool is_map(const YAML::Node& node, const std::string& what)
    {
        if (node.IsMap()) return true;
        complain(node.Mark(), what + " must be a mapping of keys to values");
        return false;
    }
    void finish()
    {
        if (!m_problems.empty()) throw GraphError(std::move(m_problems));
    }

private:
    std::string m_file;
    std::vector<Problem> m_problems;
};
} // namespace

const std::vector<std::pair<std::string, std::string>>& renderer_roles()
{
    static const std::vector<std::pair<std::string, std::string>> roles = {
        {"beauty", "the picture: radiance of all light"},
        {"albedo", "colour of the first surface that is not a mirror"},
        {"normal", "normal of that surface"},
        {"depth", "distance from the camera"},
        {"position", "place of the visible surface"},
        {"motion", "motion between frames"},
        {"uv", "texture coordinates"},
        {"variance", "variance of the beauty"},
        {"relative_variance", "variance over the squared mean"},
        {"count", "samples per pixel"},
        {"histogram", "ray colour histogram"},
        {"diffuse", "light by way of diffuse surfaces"},
        {"diffuse_direct", "direct part of it"},
        {"diffuse_indirect", "indirect part of it"},
        {"diffuse_color", "colour of diffuse surfaces"},
        {"glossy", "light by way of glossy surfaces"},
        {"glossy_direct", "direct part of it"},
        {"glossy_indirect", "indirect part of it"},
        {"glossy_color", "colour of glossy surfaces"},
        {"transmission", "light through surfaces"},
        {"transmission_direct", "direct part of it"},
        {"transmission_indirect", "indirect part of it"},
        {"transmission_color", "colour of transmissive surfaces"},
        {"subsurface", "light from below surfaces"},
        {"volume", "light from volumes"},
        {"emission", "light of visible emitters"},
        {"environment", "light of the visible surroundings"},
        {"shadow", "shadow"},
        {"ambient_occlusion", "ambient occlusion"},
        {"object_id", "number of the object"},
        {"material_id", "number of the material"},
        {"cryptomatte", "ids and coverage, never filtered"},
    };
    return roles;
}

RendererMap RendererMap::read(const std::string& path)
{
    std::ifstream in(path, std::ios::binary);
    if (!in) throw InputError(path + ": cannot be opened for reading");
    std::ostringstream text;
    text << in.rdbuf();
    return parse(text.str(), path);
}

RendererMap RendererMap::parse(const std::string& text, const std::string& name)
{
    YAML::Node root;
    try {
        root = YAML::Load(text);
    } catch (const YAML::Exception& e) {
        std::vector<Problem> problems;
        problems.push_back({{name, e.mark.line + 1, e.mark.column + 1}, "not YAML: " + e.msg});
        throw GraphError(std::move(problems));
    }
    MapReader reader(name);
    RendererMap map;
    if (!root.IsMap()) {
        reader.complain(YAML::Mark(), "a renderer map begins with 'renderer: NAME'");
        reader.finish();
    }
    reader.keys(root, {"renderer", "doc", "detect", "roles"}, "a renderer map");
    if (const YAML::Node n = root["renderer"]; n && n.IsScalar())
        map.m_name = n.Scalar();
    else
        reader.complain(root.Mark(), "'renderer: NAME' is missing");
    if (const YAML::Node n = root["doc"]; n && n.IsScalar()) map.m_doc = n.Scalar();
    if (const YAML::Node n = root["detect"]; n && reader.is_map(n, "'detect'")) {
        reader.keys(n, {"metadata", "channels"}, "'detect'");
        if (n["metadata"]) map.m_metadata = reader.texts(n["metadata"], "'metadata'");
        if (n["channels"]) map.m_channels = reader.texts(n["channels"], "'channels'");
    }
    std::vector<std::string> known;
    for (const auto& [role, doc] : renderer_roles()) known.push_back(role);
    if (const YAML::Node roles = root["roles"]; !roles) {
        reader.complain(root.Mark(), "'roles' is missing");
    } else if (reader.is_map(roles, "'roles'")) {
        reader.keys(roles, known, "'roles'");
        for (const auto& entry : roles) {
            RoleRule rule;
            if (entry.second.IsMap()) {
                reader.keys(entry.second, {"layers", "variance_of"}, "a role");
                if (entry.second["layers"])
                    rule.layers = reader.texts(entry.second["layers"], "'layers'");
                else
                    reader.complain(entry.second.Mark(), "'layers' is missing");
                if (const YAML::Node of = entry.second["variance_of"]) {
                    rule.variance_of = of.IsScalar() ? of.Scalar() : "";
                    if (rule.variance_of != "sample" && rule.variance_of != "mean")
                        reader.complain(of.Mark(), "'variance_of' is 'sample' (of one sample) or "
                                                   "'mean' (of the pixel)");
                }
            } else {
                rule.layers = reader.texts(entry.second, "a role");
            }
            if (entry.first.IsScalar()) {
                if (entry.first.Scalar() == "variance" && rule.variance_of.empty())
                    reader.complain(entry.second.Mark(),
                                    "a variance needs 'variance_of: sample' or 'mean'");
                map.m_roles.emplace_back(entry.first.Scalar(), std::move(rule));
            }
        }
    }
    reader.finish();
    return map;
}

bool RendererMap::recognises(const ImageFile& file) const
{
    for (const PartInfo& part : file.parts()) {
        for (const std::string& pattern : m_metadata)
            for (const auto& attribute : part.spec->extra_attribs)
                if (matches(pattern, attribute.name().string())) return true;
        for (const std::string& pattern : m_channels)
            for (const std::string& channel : part.spec->channelnames)
                if (matches(pattern, channel)) return true;
    }
    return false;
}

const RoleRule* RendererMap::rule(std::string_view role) const
{
    for (const auto& [name, rule] : m_roles)
        if (name == role) return &rule;
    return nullptr;
}

std::vector<ChannelSelection> RendererMap::resolve_all(const ImageFile& file,
                                                       std::string_view role) const
{
    std::vector<ChannelSelection> found;
    if (const RoleRule* r = rule(role))
        for (const std::string& pattern : r->layers)
            for (const LayerInfo& layer : file.layers())
                if (auto selection = match_layer(pattern, layer)) {
                    const bool known =
                        std::any_of(found.begin(), found.end(), [&](const ChannelSelection& s) {
                            return s.part == selection->part && s.channels == selection->channels;
                        });
                    if (!known) found.push_back(std::move(*selection));
                }
    return found;
}

std::optional<ChannelSelection> RendererMap::resolve(const ImageFile& file,
                                                     std::string_view role) const
{
    auto all = resolve_all(file, role);
    if (all.empty()) return std::nullopt;
    return std::move(all.front());
}

std::vector<std::string> RendererMap::roles_of(const ImageFile& file, const LayerInfo& layer) const
{
    std::vector<std::string> roles;
    for (const auto& [role, rule] : m_roles) {
        // Roles one layer plays are told of the layer that gets the part, and of every id layer.
        const auto all = resolve_all(file, role);
        for (std::size_t i = 0; i < all.size(); ++i) {
            const ChannelSelection& s = all[i];
            const bool here =
                s.part == layer.part && std::find(layer.channels.begin(), layer.channels.end(),
                                                  s.channels.front()) != layer.channels.end();
            if (here && (i == 0 || role == "cryptomatte")) {
                std::string text = role;
                if (s.channels.size() != layer.channels.size())
                    text += " (" + join_names(s.names) + ")";
                if (!rule.variance_of.empty())
                    text += rule.variance_of == "sample" ? " (of one sample)" : " (of the mean)";
                roles.push_back(text);
                break;
            }
        }
    }
    return roles;
}

std::vector<RendererMap> read_renderer_maps(const std::string& folder)
{
    std::vector<std::string> paths;
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error))
        if (entry.path().extension() == ".yaml") paths.push_back(entry.path().string());
    std::sort(paths.begin(), paths.end());
    std::vector<RendererMap> maps;
    for (const std::string& path : paths) maps.push_back(RendererMap::read(path));
    std::stable_partition(maps.begin(), maps.end(),
                          [](const RendererMap& m) { return !m.is_fallback(); });
    if (maps.empty()) throw InputError(folder + ": holds no renderer map (*.yaml)");
    return maps;
}

std::vector<RendererMap> standard_renderer_maps()
{
    std::vector<RendererMap> maps;
    const std::vector<std::filesystem::path> folders = graph_folders();
    for (std::size_t i = 0; i < folders.size(); ++i) {
        const std::filesystem::path folder = folders[i] / "renderers";
        const bool shipped = i + 1 == folders.size();
        if (!shipped && !std::filesystem::is_directory(folder)) continue;
        for (RendererMap& map : read_renderer_maps(folder.string())) maps.push_back(std::move(map));
    }
    std::stable_partition(maps.begin(), maps.end(),
                          [](const RendererMap& m) { return !m.is_fallback(); });
    return maps;
}

const RendererMap& detect_renderer(const std::vector<RendererMap>& maps, const ImageFile& file)
{
    for (const RendererMap& map : maps)
        if (map.recognises(file)) return map;
    return maps.back();
}

ChannelSelection default_layer(const ImageFile& file, std::string_view role)
{
    const auto maps = standard_renderer_maps();
    const RendererMap& map = detect_renderer(maps, file);
    std::vector<std::string> tried;
    for (const RendererMap* m : {&map, &maps.back()}) {
        if (auto found = m->resolve(file, role)) return *found;
        if (const RoleRule* rule = m->rule(role))
            for (const std::string& layer : rule->layers)
                if (std::find(tried.begin(), tried.end(), layer) == tried.end())
                    tried.push_back(layer);
    }
    if (file.layers().size() == 1) return whole(file.layers().front());
    std::vector<std::string> there;
    for (const LayerInfo& layer : file.layers())
        there.push_back(layer.address().empty() ? std::string(plain) : layer.address());
    std::string message =
        file.path() + ": no layer is the " + std::string(role) + " of a " + map.name() + " render";
    if (!tried.empty()) message += " (looked for " + join_names(tried, true) + ")";
    if (there.size() > 24) {
        there.resize(24);
        there.push_back("more");
    }
    throw InputError(message + "; name the layer; there is: " + join_names(there));
}

ChannelSelection choose_channels(const ImageFile& file, const ChannelRequest& r)
{
    std::string role = r.role;
    if (role.empty() && r.channels == "RGB") role = "beauty";
    if (r.layer.empty() && r.part.empty() && !role.empty())
        return file.narrow(default_layer(file, role), r.channels);
    return file.narrow(file.select(r.layer, r.part), r.channels);
}

FileDescription describe_layers(const std::string& path)
{
    const auto file = ImageFile::open(path);
    const auto maps = standard_renderer_maps();
    const RendererMap& map = detect_renderer(maps, *file);
    FileDescription out{path, file->format(), map.name(), {}, file->parts()};
    for (const LayerInfo& layer : file->layers()) {
        LayerDescription d;
        d.layer = layer.address().empty() ? std::string(plain) : layer.address();
        d.part = layer.part_name;
        d.channels = layer.channel_names;
        const OIIO::ImageSpec& spec = *file->parts()[static_cast<std::size_t>(layer.part)].spec;
        std::vector<std::string> types;
        for (const int c : layer.channels) {
            const std::string type = spec.channelformat(c).c_str();
            if (std::find(types.begin(), types.end(), type) == types.end()) types.push_back(type);
        }
        d.types = OIIO::Strutil::join(types, "/");
        d.roles = map.roles_of(*file, layer);
        out.layers.push_back(std::move(d));
    }
    return out;
}

// Names come from the file: what would steer the terminal, or end the line, is escaped.
static std::string shown(const std::string& name)
{
    const bool plain_text = std::ranges::none_of(
        name, [](char c) { return static_cast<unsigned char>(c) < ' ' || c == 0x7f; });
    return plain_text ? name : json_quote(name);
}

std::string FileDescription::text() const
{
    std::string out = path + ": " + format + ", layers as in " + renderer + " renders\n";
    for (const PartInfo& part : parts) {
        out += part.name.empty() ? "  image" : "  part '" + shown(part.name) + "'";
        out += ": " + part.data.text();
        if (part.display != part.data) out += " in a display window of " + part.display.text();
        out += part.deep ? ", deep" : "";
        const std::string compression = part.spec->get_string_attribute("compression");
        if (!compression.empty()) out += ", " + compression;
        if (part.spec->tile_width > 0)
            out += ", tiles of " + std::to_string(part.spec->tile_width) + "x" +
                   std::to_string(part.spec->tile_height);
        out += "\n";
    }
    std::size_t name_width = 5, channel_width = 8, type_width = 4;
    const auto channel_text = [](const LayerDescription& l) {
        std::string names;
        if (l.channels.size() > 6)
            return shown(l.channels.front()) + " … " + shown(l.channels.back()) + " (" +
                   std::to_string(l.channels.size()) + ")";
        for (const std::string& name : l.channels)
            names += (names.empty() ? "" : " ") + shown(name);
        return names;
    };
    for (const LayerDescription& l : layers) {
        name_width = std::max(name_width, shown(l.layer).size());
        channel_width = std::max(channel_width, channel_text(l).size());
        type_width = std::max(type_width, l.types.size());
    }
    const auto line = [&](const std::string& a, const std::string& b, const std::string& c,
                          const std::string& d) {
        const auto pad = [](const std::string& s, std::size_t n) {
            return s + std::string(n > s.size() ? n - s.size() : 0, ' ');
        };
        std::string text = "  " + pad(a, name_width) + "  " + pad(b, channel_width) + "  " +
                           pad(c, type_width) + "  " + d;
        while (text.back() == ' ') text.pop_back();
        out += text + "\n";
    };
    line("layer", "channels", "type", "understood as");
    for (const LayerDescription& l : layers)
        line(shown(l.layer), channel_text(l), l.types,
             l.roles.empty() ? "-" : OIIO::Strutil::join(l.roles, ", "));
    return out;
}

std::string FileDescription::json() const
{
    const auto list = [](const std::vector<std::string>& items) {
        std::string out = "[";
        for (const std::string& item : items) out += (out.size() > 1 ? "," : "") + json_quote(item);
        return out + "]";
    };
    const auto window = [](const Region& r) {
        return "{\"x\":" + std::to_string(r.x0) + ",\"y\":" + std::to_string(r.y0) +
               ",\"width\":" + std::to_string(r.width()) +
               ",\"height\":" + std::to_string(r.height()) + "}";
    };
    std::string out = "{\"file\":" + json_quote(path) + ",\"format\":" + json_quote(format) +
                      ",\"renderer\":" + json_quote(renderer) + ",\"parts\":[";
    for (std::size_t i = 0; i < parts.size(); ++i)
        out += (i > 0 ? "," : "") + ("{\"name\":" + json_quote(parts[i].name)) +
               ",\"data_window\":" + window(parts[i].data) +
               ",\"display_window\":" + window(parts[i].display) +
               ",\"deep\":" + (parts[i].deep ? "true" : "false") + "}";
    out += "],\"layers\":[";
    for (std::size_t i = 0; i < layers.size(); ++i)
        out += (i > 0 ? "," : "") + ("{\"layer\":" + json_quote(layers[i].layer)) +
               ",\"part\":" + json_quote(layers[i].part) +
               ",\"channels\":" + list(layers[i].channels) +
               ",\"type\":" + json_quote(layers[i].types) + ",\"roles\":" + list(layers[i].roles) +
               "}";
    return out + "]}";
}

} // namespace rayloom

// SPDX-License-Identifier: Apache-2.0
/// \file
/// Which layer of a file is the beauty, the albedo, the variance: one map per renderer, read from
/// graphs/renderers/*.yaml. docs/images.md shows how to write one.
#pragma once

#include "rayloom/image/exr_reader.h"

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace rayloom
{

/// What a map knows of one role.
struct RoleRule {
    /// Layers in order of preference; `*` stands for any characters, `(plain)` for channels
    /// without a layer name. Compared with a layer's address, its name, its pass and, where a
    /// channel is meant, the channel's full name.
    std::vector<std::string> layers;
    /// Of a variance: "sample" (of one sample) or "mean" (of the pixel); empty elsewhere.
    std::string variance_of;
};

/// Names of layers in the files of one renderer.
class RendererMap
{
public:
    /// Reads a map. Throws GraphError with every problem (file:line:column) and InputError.
    static RendererMap read(const std::string& path);
    static RendererMap parse(const std::string& text, const std::string& name);

    const std::string& name() const { return m_name; }
    const std::string& doc() const { return m_doc; }
    /// Whether the file looks as if this renderer had written it.
    bool recognises(const ImageFile& file) const;
    /// A map that recognises by no rule serves files nobody recognises.
    bool is_fallback() const { return m_metadata.empty() && m_channels.empty(); }

    /// The channels that play a role; the first where several layers would do. Nothing when none
    /// does.
    std::optional<ChannelSelection> resolve(const ImageFile& file, std::string_view role) const;
    /// Every layer that plays a role (a cryptomatte has several).
    std::vector<ChannelSelection> resolve_all(const ImageFile& file, std::string_view role) const;
    /// Roles a layer plays, in the map's order; each as "albedo", or "variance (of a sample)".
    std::vector<std::string> roles_of(const ImageFile& file, const LayerInfo& layer) const;
    const RoleRule* rule(std::string_view role) const;

private:
    std::string m_name, m_doc;
    std::vector<std::string> m_metadata, m_channels;
    std::vector<std::pair<std::string, RoleRule>> m_roles;
};

/// Every role a map may name, with what it means.
const std::vector<std::pair<std::string, std::string>>& renderer_roles();

/// The maps of a folder, fallback last. Throws as RendererMap::read(), and InputError when there is
/// none.
std::vector<RendererMap> read_renderer_maps(const std::string& folder);
/// The maps in renderers/ of the folders of $RAYLOOM_GRAPH_PATH, then those that come with rayloom.
std::vector<RendererMap> standard_renderer_maps();
/// The first map that recognises the file, else the fallback. `maps` is not empty.
const RendererMap& detect_renderer(const std::vector<RendererMap>& maps, const ImageFile& file);

/// The layer that plays a role by the standard maps; where none does, the file's only layer. Throws
/// InputError that says which names were looked for and what there is.
ChannelSelection default_layer(const ImageFile& file, std::string_view role);

/// What a graph or command asks of a file.
struct ChannelRequest {
    std::string layer;    ///< address; empty: by role
    std::string part;     ///< name or number; empty: any
    std::string role;     ///< used without a layer; empty: the beauty when `channels` is "RGB"
    std::string channels; ///< as ImageFile::narrow() reads it; empty: "any"
};
/// The channels asked for: by layer, else by role, else the whole first part. Throws InputError.
ChannelSelection choose_channels(const ImageFile& file, const ChannelRequest& request);

/// What rayloom understands of one layer; `rayloom info FILE` prints these.
struct LayerDescription {
    std::string layer; ///< address; "(plain)" for channels without a layer name
    std::string part;
    std::vector<std::string> channels;
    std::string types; ///< "half", or "half/float"
    std::vector<std::string> roles;
};
struct FileDescription {
    std::string path, format, renderer;
    std::vector<LayerDescription> layers;
    std::vector<PartInfo> parts;

    std::string text() const;
    std::string json() const;
};
FileDescription describe_layers(const std::string& path);

} // namespace rayloom

// SPDX-License-Identifier: Apache-2.0
// Which channels an address means.
#include "rayloom/core/text.h"
#include "rayloom/image/image_file.h"
#include "rayloom/image/image_input.h"

#include <OpenImageIO/strutil.h>

#include <algorithm>
#include <array>
#include <set>

namespace rayloom
{

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
        fail_input(m_path,
                   "has no part '" + std::string(part_text) + "'" + suggestion(part_text, names));
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
        fail_input(m_path, "'" + text + "' may be " + join_names(names, true) +
                               "; write which of them is meant");
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
    fail_input(m_path, "has no layer '" + text + "'" + hint);
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
            fail_input(m_path,
                       (s.layer.empty() ? std::string("it") : "layer '" + s.layer + "'") +
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
                fail_input(m_path,
                           (s.layer.empty() ? std::string("it") : "layer '" + s.layer + "'") +
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

} // namespace rayloom

// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/reference.h"

#include "rayloom/core/text.h"

#include <algorithm>
#include <charconv>
#include <cmath>

namespace rayloom
{

namespace
{

const char* kind_name(PortKind kind)
{
    switch (kind) {
    case PortKind::image: return "image";
    case PortKind::list: return "list of images";
    case PortKind::deep: return "deep image";
    case PortKind::table: return "figures";
    }
    return "";
}

/// Breaks prose at 96 columns, every line indented.
std::string wrapped(const std::string& text, const std::string& indent)
{
    std::string out, line = indent;
    std::size_t i = 0;
    const auto flush = [&] {
        while (!line.empty() && line.back() == ' ') line.pop_back();
        out += line + "\n";
        line = indent;
    };
    while (i < text.size()) {
        if (text[i] == '\n') {
            flush();
            ++i;
            continue;
        }
        const std::size_t end = std::min(text.find_first_of(" \n", i), text.size());
        const std::string word = text.substr(i, end - i);
        if (line.size() + word.size() > 96 && line != indent) flush();
        line += word;
        i = end;
        if (i < text.size() && text[i] == ' ') {
            line += ' ';
            ++i;
        }
    }
    if (line != indent) flush();
    return out;
}

/// Integer limits of the type say nothing to a reader.
bool telling(const std::optional<double>& bound)
{
    return bound && std::abs(*bound) < static_cast<double>(std::numeric_limits<int>::max());
}

/// A default that came from a float member, as it was written: 2.2 and not 2.200000047683716.
double as_written(double v)
{
    const auto narrow = static_cast<float>(v);
    if (static_cast<double>(narrow) != v) return v;
    char buffer[32];
    const auto text = std::to_chars(buffer, buffer + sizeof buffer, narrow);
    std::from_chars(buffer, text.ptr, v);
    return v;
}

std::string default_text(const ParamInfo& param)
{
    ParamValue value = param.default_value;
    if (auto* real = std::get_if<double>(&value)) *real = as_written(*real);
    if (auto* reals = std::get_if<std::vector<double>>(&value))
        for (double& v : *reals) v = as_written(v);
    return format_param(value);
}

std::string cell(std::string text)
{
    std::string out;
    for (const char c : text) {
        if (c == '|') out += '\\';
        out += c == '\n' ? ' ' : c;
    }
    return out;
}

} // namespace

std::string param_summary(const ParamInfo& param)
{
    std::string out;
    if (param.type == ParamType::choice) {
        out = "one of: " + join_names(param.choices);
    } else {
        out = param_type_name(param.type);
        const std::string low = telling(param.min) ? format_param(*param.min) : "";
        const std::string high = telling(param.max) ? format_param(*param.max) : "";
        if (!low.empty() && !high.empty())
            out += " from " + low + " to " + high;
        else if (!low.empty())
            out += " at least " + low;
        else if (!high.empty())
            out += " at most " + high;
    }
    if (!param.unit.empty()) out += ", in " + param.unit;
    return out;
}

std::string node_help(const NodeInfo& node)
{
    std::string out =
        node.name + " (version " + std::to_string(node.version) + "): " + node.summary + "\n";
    if (!node.doc.empty()) out += "\n" + wrapped(node.doc, "  ");
    const auto ports = [&](const char* title, const std::vector<PortInfo>& list) {
        if (list.empty()) return;
        out += std::string("\n") + title + "\n";
        for (const PortInfo& p : list) {
            out +=
                "  " + p.name + ": " + kind_name(p.kind) + (p.required ? "" : ", optional") + "\n";
            out += wrapped(p.doc, "      ");
        }
    };
    ports("Inputs", node.inputs);
    ports("Outputs", node.outputs);
    if (!node.params.empty()) {
        out += "\nParameters\n";
        for (const ParamInfo& p : node.params) {
            out += "  " + p.name + ": " + param_summary(p) +
                   (p.required ? "; must be given" : "; default " + default_text(p)) + "\n";
            out += wrapped(p.doc + (p.source.empty() ? "" : " (" + p.source + ")"), "      ");
        }
    }
    if (!node.source.empty()) out += "\nSource\n" + wrapped(node.source, "  ");
    if (!node.accuracy.empty()) out += "\nAccuracy\n" + wrapped(node.accuracy, "  ");
    if (!node.example.empty())
        out += "\nExample\n" + node.example + (node.example.back() == '\n' ? "" : "\n");
    if (node.origin != "built in") out += "\nLoaded from " + node.origin + "\n";
    return out;
}

std::string node_page(const NodeInfo& node)
{
    std::string out = "# " + node.name + "\n\n" + node.summary + "\n\n";
    if (!node.doc.empty()) out += node.doc + "\n\n";
    const auto ports = [&](const char* title, const std::vector<PortInfo>& list) {
        if (list.empty()) return;
        out += std::string("## ") + title + "\n\n| name | what | meaning |\n|---|---|---|\n";
        for (const PortInfo& p : list)
            out += "| `" + p.name + "` | " + kind_name(p.kind) + (p.required ? "" : ", optional") +
                   " | " + cell(p.doc) + " |\n";
        out += "\n";
    };
    ports("Inputs", node.inputs);
    ports("Outputs", node.outputs);
    if (!node.params.empty()) {
        out += "## Parameters\n\n| name | type | default | meaning |\n|---|---|---|---|\n";
        for (const ParamInfo& p : node.params)
            out += "| `" + p.name + "` | " + cell(param_summary(p)) + " | " +
                   (p.required ? "must be given" : "`" + cell(default_text(p)) + "`") + " | " +
                   cell(p.doc) + (p.source.empty() ? "" : " (" + cell(p.source) + ")") + " |\n";
        out += "\n";
    }
    if (!node.source.empty()) out += "## Source\n\n" + node.source + "\n\n";
    if (!node.accuracy.empty()) out += "## Accuracy\n\n" + node.accuracy + "\n\n";
    if (!node.example.empty())
        out += "## Example\n\n```yaml\n" + node.example +
               (node.example.back() == '\n' ? "" : "\n") + "```\n\n";
    out += "Version " + std::to_string(node.version) + ", " + node.origin + ".\n";
    return out;
}

std::string node_index(const std::vector<const NodeInfo*>& nodes)
{
    std::string out = "# Nodes\n\nMade by `rayloom docs` from the declarations of the nodes.\n";
    std::string stage;
    for (const NodeInfo* node : nodes) {
        const std::string this_stage = node->name.substr(0, node->name.find('.'));
        if (this_stage != stage) {
            stage = this_stage;
            out += "\n## " + stage + "\n\n| node | what it does |\n|---|---|\n";
        }
        out += "| [`" + node->name + "`](" + node->name + ".md) | " + cell(node->summary) + " |\n";
    }
    return out;
}

} // namespace rayloom

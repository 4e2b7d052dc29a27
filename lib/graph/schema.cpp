// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/schema.h"

#include "rayloom/core/registry.h"
#include "rayloom/core/text.h"
#include "rayloom/graph/names.h"

#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace rayloom
{

namespace
{

/// Members of a JSON object: name and JSON text of the value.
using Members = std::vector<std::pair<std::string, std::string>>;

std::string object(const Members& members)
{
    std::string out = "{";
    for (const auto& [name, value] : members)
        out += (out.size() > 1 ? ", " : "") + json_quote(name) + ": " + value;
    return out + "}";
}

std::string array(const std::vector<std::string>& items)
{
    std::string out = "[";
    for (const std::string& item : items) out += (out.size() > 1 ? ", " : "") + item;
    return out + "]";
}

/// An object with a line for each member.
std::string lines(const Members& members, const std::string& indent)
{
    std::string out = "{";
    for (const auto& [name, value] : members)
        out += (out.size() > 1 ? ",\n" : "\n") + indent + "  " + json_quote(name) + ": " + value;
    return out + "\n" + indent + "}";
}

std::string quoted_array(const std::vector<std::string>& texts)
{
    std::vector<std::string> items;
    for (const std::string& text : texts) items.push_back(json_quote(text));
    return array(items);
}

std::string definition(const std::string& name)
{
    return object({{"$ref", json_quote("#/$defs/" + name)}});
}

std::string with_doc(Members members, const std::string& doc)
{
    if (!doc.empty()) members.emplace_back("description", json_quote(doc));
    return object(members);
}

std::string json_value(const ParamValue& value)
{
    return format_param(value, json_number, json_quote);
}

/// Whether a limit says more than that an int is 32 bits wide.
bool is_limit(const ParamInfo& info, double limit)
{
    if (!std::isfinite(limit)) return false;
    return info.type != ParamType::integer ||
           (limit != std::numeric_limits<int>::min() && limit != std::numeric_limits<int>::max());
}

/// One value of a parameter.
std::string value_schema(const ParamInfo& info)
{
    Members members;
    switch (info.type) {
    case ParamType::boolean: return object({{"type", json_quote("boolean")}});
    case ParamType::integer: members = {{"type", json_quote("integer")}}; break;
    case ParamType::real:
    case ParamType::reals: members = {{"type", json_quote("number")}}; break;
    // Text is kept as written, so what looks like a number is text too.
    case ParamType::text:
    case ParamType::path:
    case ParamType::texts:
    case ParamType::paths: return definition("text");
    case ParamType::choice: {
        // A choice such as 2 is a text to the graph and a number to a YAML reader.
        std::vector<std::string> items;
        for (const std::string& choice : info.choices) {
            items.push_back(json_quote(choice));
            const ParamValue plain = plain_scalar(choice);
            if (!std::holds_alternative<std::string>(plain)) items.push_back(json_value(plain));
        }
        return object({{"enum", array(items)}});
    }
    }
    if (info.min && is_limit(info, *info.min))
        members.emplace_back("minimum", json_number(*info.min));
    if (info.max && is_limit(info, *info.max))
        members.emplace_back("maximum", json_number(*info.max));
    return object(members);
}

/// A parameter: a value, a `$name`, or a list of those (for a parameter of one value: one for each
/// element of the list the node is mapped over).
std::string param_schema(const ParamInfo& info)
{
    const std::string one = array({value_schema(info), definition("parameter")});
    Members items{{"type", json_quote("array")}, {"items", object({{"anyOf", one}})}};
    if (!is_list(info.type)) items.emplace_back("minItems", "1");
    std::string doc = info.doc;
    if (!info.unit.empty() && info.unit != "1")
        doc += (doc.empty() ? "In " : " In ") + info.unit + ".";
    Members members{{"anyOf", array({value_schema(info), definition("parameter"), object(items)})}};
    if (!info.required) members.emplace_back("default", json_value(info.default_value));
    return with_doc(members, doc);
}

std::string port_schema(const PortInfo& port)
{
    return with_doc({{"$ref", json_quote("#/$defs/references")}}, port.doc);
}

std::string node_schema(const NodeInfo& info)
{
    Members properties{{"op", with_doc({{"const", json_quote(info.name)}}, info.summary)}};
    std::vector<std::string> required{"op"};
    for (const PortInfo& port : info.inputs) {
        properties.emplace_back(port.name, port_schema(port));
        if (port.required) required.push_back(port.name);
    }
    for (const ParamInfo& param : info.params) {
        properties.emplace_back(param.name, param_schema(param));
        if (param.required) required.push_back(param.name);
    }
    properties.emplace_back("when", definition("when"));
    properties.emplace_back("otherwise", definition("otherwise"));
    return with_doc({{"properties", object(properties)},
                     {"required", quoted_array(required)},
                     {"additionalProperties", "false"}},
                    info.summary);
}

/// `{name: …}` with names of graph things.
std::string names_to(const std::string& value, const std::string& doc)
{
    return with_doc({{"type", array({json_quote("object"), json_quote("null")})},
                     {"propertyNames", definition("name")},
                     {"additionalProperties", value}},
                    doc);
}

std::string text_property(const std::string& doc)
{
    return with_doc({{"$ref", json_quote("#/$defs/text")}}, doc);
}

std::string graph_param_schema()
{
    const std::string number = object({{"type", json_quote("number")}});
    const std::string literal =
        array({json_quote("boolean"), json_quote("number"), json_quote("string")});
    const std::string list =
        object({{"type", json_quote("array")}, {"items", object({{"type", literal}})}});
    const std::string any = object({{"anyOf", array({object({{"type", literal}}), list})}});
    const Members properties{
        {"type", object({{"enum", quoted_array(param_type_names())}})},
        {"default", any},
        {"min", number},
        {"max", number},
        {"choices",
         object({{"type", json_quote("array")}, {"items", definition("text")}, {"minItems", "1"}})},
        {"unit", text_property("px, radiance, …")},
        {"doc", text_property("One sentence.")},
        {"source", text_property("Where it comes from: paper and equation.")}};
    const std::string mapping = object({{"type", json_quote("object")},
                                        {"properties", object(properties)},
                                        {"additionalProperties", "false"}});
    return object({{"anyOf", array({object({{"type", literal}}), list, mapping})}});
}

std::string graph_input_schema()
{
    const std::string channels = object(
        {{"anyOf", array({definition("text"),
                          object({{"type", json_quote("array")}, {"items", definition("text")}})})},
         {"description", json_quote("RGB, any, or names of channels.")}});
    const Members properties{
        {"doc", text_property("What it is.")},
        {"channels", channels},
        {"kind", object({{"enum", quoted_array({"image", "list", "deep"})}})},
        {"list", object({{"type", json_quote("boolean")}})},
        {"optional", object({{"type", json_quote("boolean")}})},
        {"role", text_property("beauty, albedo, …: the renderer map names its layer.")},
        {"neighbours", text_property("input@-5..-1: frames of another input's pattern.")}};
    const std::string mapping = object({{"type", json_quote("object")},
                                        {"properties", object(properties)},
                                        {"additionalProperties", "false"}});
    return object(
        {{"anyOf", array({object({{"type", json_quote("null")}}), definition("text"), mapping})}});
}

std::string graph_output_schema()
{
    const std::string mapping = object(
        {{"type", json_quote("object")},
         {"properties",
          object({{"from", definition("reference")}, {"doc", text_property("What it is.")}})},
         {"required", quoted_array({"from"})},
         {"additionalProperties", "false"}});
    return object({{"anyOf", array({definition("reference"), mapping})}});
}

} // namespace

std::string graph_schema()
{
    const std::string name = "[A-Za-z_][A-Za-z0-9_-]*";
    const std::string text_type = json_quote("string");
    const auto pattern = [&](const std::string& expression, const std::string& doc) {
        return object({{"type", text_type},
                       {"pattern", json_quote("^" + expression + "$")},
                       {"description", json_quote(doc)}});
    };
    Members definitions{
        {"name", object({{"pattern", json_quote("^" + name + "$")}})},
        {"text", object({{"type", array({json_quote("string"), json_quote("number"),
                                         json_quote("boolean")})}})},
        {"parameter", pattern("\\$" + name, "A parameter of the graph: $name.")},
        {"reference", pattern(name + "(\\." + name + ")?(\\[[0-9]+\\])?",
                              "A node or an input: name, name.output or name[index].")},
        {"references", object({{"anyOf", array({definition("reference"),
                                                object({{"type", json_quote("array")},
                                                        {"items", definition("reference")},
                                                        {"minItems", "1"}})})}})},
        {"when",
         object({{"type", array({json_quote("string"), json_quote("boolean")})},
                 {"description", json_quote("Run the node only when this holds: has(color), "
                                            "count(frames) > 1, channels(color) == 4, black(lobe), "
                                            "$param, and, or, not.")}})},
        {"otherwise", with_doc({{"$ref", json_quote("#/$defs/reference")}},
                               "Stands in for the node's output when 'when' does not hold.")},
        {"param", graph_param_schema()},
        {"input", graph_input_schema()},
        {"output", graph_output_schema()}};

    std::vector<std::string> ops;
    std::vector<std::string> cases;
    for (const NodeInfo* info : Registry::instance().all()) {
        definitions.emplace_back(info->name, node_schema(*info));
        ops.push_back(info->name);
        cases.push_back(object(
            {{"if",
              object({{"properties", object({{"op", object({{"const", json_quote(info->name)}})}})},
                      {"required", quoted_array({"op"})}})},
             {"then", definition(info->name)}}));
    }
    std::vector<std::string> op_kinds{pattern("graph:.+", "Another graph file, used as a node."),
                                      definition("parameter")};
    if (!ops.empty()) op_kinds.insert(op_kinds.begin(), object({{"enum", quoted_array(ops)}}));
    Members node{{"type", json_quote("object")},
                 {"required", quoted_array({"op"})},
                 {"properties", object({{"op", object({{"anyOf", array(op_kinds)}})},
                                        {"when", definition("when")},
                                        {"otherwise", definition("otherwise")}})}};
    if (!cases.empty()) node.emplace_back("allOf", array(cases));
    definitions.emplace_back("node", object(node));

    const Members properties{
        {"rayloom",
         object({{"const", "1"}, {"description", json_quote("Version of the format.")}})},
        {"name", text_property("The graph's name.")},
        {"doc", text_property("What the graph does.")},
        {"params", names_to(definition("param"), "What can be set with -p name=value.")},
        {"inputs", names_to(definition("input"), "Images the graph is given.")},
        {"nodes", names_to(definition("node"), "What is computed.")},
        {"outputs", names_to(definition("output"), "Images and tables the graph gives.")}};
    return lines({{"$schema", json_quote("https://json-schema.org/draft/2020-12/schema")},
                  {"title", json_quote("rayloom graph")},
                  {"type", json_quote("object")},
                  {"required", quoted_array({"rayloom"})},
                  {"properties", lines(properties, "  ")},
                  {"patternProperties", object({{"^x-", "true"}})},
                  {"additionalProperties", "false"},
                  {"$defs", lines(definitions, "  ")}},
                 "") +
           "\n";
}

} // namespace rayloom

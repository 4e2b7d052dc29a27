// SPDX-License-Identifier: Apache-2.0
/// \file
/// The table behind the `oiio.*` nodes: one entry per function of OpenImageIO. An entry says in
/// plan() which image comes out and which part of the inputs a region needs, and hands back what
/// fills a region: a kernel on planar rows where the arithmetic is so cheap that converting to
/// OpenImageIO's interleaved layout would cost more than the work, else a call of ImageBufAlgo on
/// the tile (see imagebuf_bridge.h).
#pragma once

#include "rayloom/core/registry.h"
#include "rayloom/image/rows.h"

#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace rayloom::oiio
{

/// Parameter values of one node: those the graph gave, and defaults for the rest.
class Arguments
{
public:
    Arguments(const std::vector<ParamInfo>& declared, const ParamValues& given);

    bool flag(std::string_view name) const { return get<bool>(name); }
    int integer(std::string_view name) const { return static_cast<int>(get<std::int64_t>(name)); }
    float real(std::string_view name) const { return static_cast<float>(get<double>(name)); }
    const std::string& text(std::string_view name) const { return get<std::string>(name); }
    const std::vector<std::string>& texts(std::string_view name) const
    {
        return get<std::vector<std::string>>(name);
    }
    std::vector<float> reals(std::string_view name) const;

private:
    template <class T>
    const T& get(std::string_view name) const
    {
        return std::get<T>(m_values.find(name)->second);
    }
    ParamValues m_values;
};

/// Fills TileContext::region(). Called from several threads at once.
using Compute = std::function<void(const TileContext&)>;

/// One entry of the table.
struct Operation {
    std::string name;    ///< without the stage: "add" is oiio.add
    std::string command; ///< the oiiotool option that does the same
    std::string summary; ///< one sentence
    std::string doc;
    std::string accuracy;
    std::vector<PortInfo> inputs; ///< the output is always `image`
    std::vector<ParamInfo> params;
    std::string
        example; ///< the node's line in a graph (inputs are named after the ports), or a graph
    std::function<Compute(PlanContext&, const Arguments&)> plan;
};

std::vector<Operation> arithmetic_operations();
std::vector<Operation> channel_operations();
std::vector<Operation> placement_operations();
std::vector<Operation> filter_operations();
std::vector<Operation> colour_operations();

/// All of the table as the registry takes it.
std::vector<NodeInfo> operation_nodes();

// --------------------------------------------------------------- helpers for writing entries

PortInfo image_port(std::string name, std::string doc);
PortInfo optional_port(std::string name, std::string doc);
ParamInfo flag_param(std::string name, bool value, std::string doc);
ParamInfo integer_param(std::string name, int value, int lo, int hi, std::string unit,
                        std::string doc);
ParamInfo real_param(std::string name, double value, std::string unit, std::string doc);
ParamInfo reals_param(std::string name, std::vector<double> value, std::string doc);
ParamInfo text_param(std::string name, std::string value, std::string doc);
/// A path that is empty unless the graph gives one.
ParamInfo path_param(std::string name, std::string doc);
ParamInfo texts_param(std::string name, std::vector<std::string> value, std::string doc);
ParamInfo choice_param(std::string name, std::string value, std::vector<std::string> choices,
                       std::string doc);
ParamInfo required(ParamInfo param);

/// One float per channel from a parameter that gives one for all or one each.
/// Throws NodeError for any other count.
std::vector<float> per_channel(const std::vector<float>& values, int channels,
                               std::string_view param);

} // namespace rayloom::oiio

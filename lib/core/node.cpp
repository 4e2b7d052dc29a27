// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/node.h"

#include "rayloom/core/text.h"

#include <algorithm>

namespace rayloom
{

// ------------------------------------------------------------------------------- PlanContext

const PlannedInput& PlanContext::find(std::string_view port) const
{
    const auto it = m_inputs.find(port);
    if (it == m_inputs.end()) throw NodeError("input '" + std::string(port) + "' is not declared");
    return it->second;
}

bool PlanContext::has(std::string_view port) const
{
    const auto it = m_inputs.find(port);
    return it != m_inputs.end() && it->second.connected;
}

std::size_t PlanContext::count(std::string_view port) const
{
    return has(port) ? find(port).images.size() : 0;
}

const ImageDesc& PlanContext::input(std::string_view port, std::size_t element) const
{
    const PlannedInput& in = find(port);
    if (!in.connected) throw NodeError("input '" + std::string(port) + "' is not connected");
    if (element >= in.images.size())
        throw NodeError("input '" + std::string(port) + "' has " +
                        std::to_string(in.images.size()) + " images; number " +
                        std::to_string(element) + " was asked for");
    return in.images[element];
}

bool PlanContext::black(std::string_view port, std::size_t element) const
{
    const PlannedInput& in = find(port);
    return in.black && in.black(element);
}

void PlanContext::output(std::string_view port, ImageDesc desc)
{
    m_result.outputs[std::string(port)] = {std::move(desc)};
}

void PlanContext::output_list(std::string_view port, std::vector<ImageDesc> descs)
{
    m_result.outputs[std::string(port)] = std::move(descs);
}

void PlanContext::needs(std::string_view port, const Halo& halo)
{
    if (halo.none()) return;
    needs(port, [halo](const Need& need) { return need.region.grown(halo); });
}

void PlanContext::needs(std::string_view port, NeedFunction function)
{
    m_result.pointwise = false;
    m_result.needs[std::string(port)] = std::move(function);
}

void PlanContext::needs_all(std::string_view port)
{
    std::vector<Region> windows;
    for (const ImageDesc& image : find(port).images) windows.push_back(image.data);
    needs(port, [windows](const Need& need) { return windows.at(need.input_element); });
}

void PlanContext::pass_through(std::string_view output, std::string_view input,
                               std::size_t output_element, std::size_t input_element)
{
    m_result.aliases.push_back(
        {std::string(output), output_element, std::string(input), input_element});
}

void PlanContext::pass_channel(std::string_view output, int output_channel, std::string_view input,
                               int input_channel, std::size_t output_element,
                               std::size_t input_element)
{
    m_result.channel_aliases.push_back({std::string(output), output_element, output_channel,
                                        std::string(input), input_element, input_channel});
}

void PlanContext::constant(std::string_view output, float value, std::size_t element)
{
    m_result.constants.push_back({std::string(output), element, value});
}

void PlanContext::reduce(const Region& domain, std::size_t values, int block_rows)
{
    m_result.reduction = Reduction{domain, values, std::max(1, block_rows)};
}

void PlanContext::reduce_needs(std::string_view port, const Halo& halo)
{
    reduce_needs(port, [halo](const Need& need) { return need.region.grown(halo); });
}

void PlanContext::reduce_needs(std::string_view port, NeedFunction function)
{
    m_result.reduce_needs[std::string(port)] = std::move(function);
}

void PlanContext::access(Access access, int row_alignment)
{
    m_result.access = access;
    m_result.row_alignment = std::max(1, row_alignment);
}

void PlanContext::sink(const Region& domain)
{
    m_result.sink = domain;
    m_result.access = Access::rows;
}

std::vector<int> PlanContext::require_channels(std::string_view port,
                                               std::span<const std::string> names,
                                               std::size_t element) const
{
    const ImageDesc& image = input(port, element);
    std::vector<int> indices;
    for (const std::string& name : names) {
        const int i = image.channel(name);
        if (i < 0)
            throw NodeError("input '" + std::string(port) + "' has no channel '" + name + "'" +
                            suggestion(name, image.channels));
        indices.push_back(i);
    }
    return indices;
}

void PlanContext::require_same_window(std::string_view a, std::string_view b, std::size_t a_element,
                                      std::size_t b_element) const
{
    const Region &ra = input(a, a_element).data, &rb = input(b, b_element).data;
    if (ra != rb)
        throw NodeError("inputs '" + std::string(a) + "' (" + ra.text() + ") and '" +
                        std::string(b) + "' (" + rb.text() + ") must cover the same pixels");
}

// ------------------------------------------------------------------------------- TileContext

const TileContext::Input* TileContext::find(std::string_view port) const
{
    for (const Input& in : m_inputs)
        if (in.port == port) return &in;
    return nullptr;
}

bool TileContext::has(std::string_view port) const { return find(port) != nullptr; }

std::size_t TileContext::count(std::string_view port) const
{
    const Input* in = find(port);
    return in ? in->images.size() : 0;
}

ConstImageView TileContext::input(std::string_view port, std::size_t element) const
{
    const Input* in = find(port);
    if (!in || element >= in->images.size())
        throw Error("compute() asked for element " + std::to_string(element) + " of input '" +
                    std::string(port) + "', which is not there");
    return in->images[element];
}

DeepView TileContext::deep(std::string_view port) const
{
    const Input* in = find(port);
    if (!in || in->deep.empty())
        throw Error("compute() asked for deep input '" + std::string(port) +
                    "', which is not there");
    return in->deep[0];
}

const Table& TileContext::table(std::string_view port) const
{
    const Input* in = find(port);
    if (!in || !in->table)
        throw Error("compute() asked for table '" + std::string(port) + "', which is not there");
    return *in->table;
}

bool TileContext::wants(std::string_view port) const
{
    return std::any_of(m_outputs.begin(), m_outputs.end(),
                       [&](const Output& o) { return o.port == port; });
}

ImageView TileContext::output(std::string_view port) const
{
    for (const Output& out : m_outputs)
        if (out.port == port) return out.view;
    throw Error("compute() asked for output '" + std::string(port) + "', which nobody wants");
}

// ------------------------------------------------------------------------------- Node

void Node::reduce(const TileContext&, std::span<double>) const
{
    throw Error("the node asked for a reduction in plan() and has no reduce()");
}

void Node::combine(std::span<double> into, std::span<const double> other) const
{
    for (std::size_t i = 0; i < into.size(); ++i) into[i] += other[i];
}

std::map<std::string, Table, std::less<>> Node::finish(std::span<const double>,
                                                       std::span<const TileContext::Input>)
{
    return {};
}

std::string Node::content_key(bool) const { return {}; }

DeepRow Node::read_deep_row(int) const
{
    throw Error("the node has a deep output and no read_deep_row()");
}

// ------------------------------------------------------------------------------- DeepRow

std::size_t DeepRow::bytes() const
{
    std::size_t n = first.size() * sizeof(std::uint32_t);
    for (const auto& channel : samples) n += channel.size() * sizeof(float);
    return n;
}

} // namespace rayloom

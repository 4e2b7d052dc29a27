// SPDX-License-Identifier: Apache-2.0
#include "tests/stress/reach.h"

#include <algorithm>
#include <functional>

namespace rayloom::test
{

Reach::Reach(const Graph& graph, const RunRequest& request, const Region& box)
    : m_plan(make_plan(graph, request)), m_box(box)
{
    for (const PlannedOutput& output : m_plan.outputs)
        if (output.sink_item >= 0) m_sinks[output.name].push_back(output.sink_item);
}

bool Reach::reaches(const std::string& output, std::size_t image, int x, int y) const
{
    return std::ranges::any_of(read_for(output, image, x, y), [&](const auto& read) {
        return !read.second.intersect(m_box).empty();
    });
}

Reach::Regions Reach::read_for(const std::string& output, std::size_t image, int x, int y) const
{
    Regions read;
    // Producers stand before consumers: from the sink backwards, each item is asked once.
    std::map<int, Region, std::greater<>> asked;
    asked[m_sinks.find(output)->second.at(image)] = {x, y, x + 1, y + 1};
    while (!asked.empty()) {
        const auto [number, region] = *asked.begin();
        asked.erase(asked.begin());
        const WorkItem& item = m_plan.items[static_cast<std::size_t>(number)];
        const PlannedOp& op = m_plan.ops[static_cast<std::size_t>(item.op)];
        if (item.inputs.empty()) read[op.id] = read[op.id].hull(region);
        for (const WorkItem::Input& in : item.inputs) {
            const auto needs = op.result.needs.find(in.port);
            for (std::size_t e = 0; e < in.streams.size(); ++e) {
                const Stream& stream = m_plan.streams[static_cast<std::size_t>(in.streams[e])];
                if (stream.item < 0) continue;
                Region need = needs == op.result.needs.end()
                                  ? region
                                  : needs->second({e, item.element, region});
                need = need.intersect(stream.desc.data);
                if (need.empty()) continue;
                const auto [it, is_new] = asked.emplace(stream.item, need);
                if (!is_new) it->second = it->second.hull(need);
            }
        }
    }
    return read;
}

} // namespace rayloom::test

// SPDX-License-Identifier: Apache-2.0
#include "tests/stress/reach.h"

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
    // Producers stand before consumers: from the sink backwards, each item is asked once.
    std::map<int, Region, std::greater<>> asked;
    asked[m_sinks.find(output)->second.at(image)] = {x, y, x + 1, y + 1};
    while (!asked.empty()) {
        const auto [number, region] = *asked.begin();
        asked.erase(asked.begin());
        const WorkItem& item = m_plan.items[static_cast<std::size_t>(number)];
        if (item.inputs.empty() && !region.intersect(m_box).empty()) return true;
        const PlanResult& result = m_plan.ops[static_cast<std::size_t>(item.op)].result;
        for (const WorkItem::Input& in : item.inputs) {
            const auto needs = result.needs.find(in.port);
            for (std::size_t e = 0; e < in.streams.size(); ++e) {
                const Stream& stream = m_plan.streams[static_cast<std::size_t>(in.streams[e])];
                if (stream.item < 0) continue;
                Region need =
                    needs == result.needs.end() ? region : needs->second({e, item.element, region});
                need = need.intersect(stream.desc.data);
                if (need.empty()) continue;
                const auto [it, is_new] = asked.emplace(stream.item, need);
                if (!is_new) it->second = it->second.hull(need);
            }
        }
    }
    return false;
}

} // namespace rayloom::test

// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/diagram_layout.h"

#include <algorithm>
#include <map>
#include <utility>

namespace rayloom::diagram
{

std::size_t letters(const std::string& text)
{
    return static_cast<std::size_t>(std::count_if(text.begin(), text.end(), [](char c) {
        return (static_cast<unsigned char>(c) & 0xc0) != 0x80;
    }));
}

double label_width(const Edge& edge)
{
    return 5.8 * static_cast<double>(letters(edge.label)) + 22.0;
}

namespace
{

constexpr double box_gap = 28.0;
constexpr double rank_gap = 58.0;

Place measure(const Box& box)
{
    // Widths of a common sans-serif face, on the generous side.
    double width = 8.0 * static_cast<double>(letters(box.id));
    width = std::max(width, 6.6 * static_cast<double>(letters(box.op)));
    for (const std::string& detail : box.details)
        width = std::max(width, 6.2 * static_cast<double>(letters(detail)));
    Place out;
    out.width = std::max(72.0, width + 28.0);
    out.height = line_height * (1.0 + (box.op.empty() ? 0.0 : 1.0) +
                                static_cast<double>(box.details.size())) +
                 16.0;
    return out;
}

/// Longest path from a source; sources stand right above what reads them first.
void assign_ranks(const Diagram& diagram, std::vector<Place>& places)
{
    // The reader refuses cycles, so as many rounds as boxes are enough; far fewer are needed.
    for (std::size_t round = 0; round < diagram.boxes.size(); ++round) {
        bool changed = false;
        for (const Edge& edge : diagram.edges) {
            const int below = places[edge.from].rank + 1;
            if (places[edge.to].rank >= below) continue;
            places[edge.to].rank = below;
            changed = true;
        }
        if (!changed) break;
    }
    std::vector<bool> source(diagram.boxes.size(), true);
    for (const Edge& edge : diagram.edges) source[edge.to] = false;
    for (std::size_t i = 0; i < diagram.boxes.size(); ++i) {
        if (!source[i]) continue;
        int nearest = -1;
        for (const Edge& edge : diagram.edges)
            if (edge.from == i)
                nearest =
                    nearest < 0 ? places[edge.to].rank : std::min(nearest, places[edge.to].rank);
        if (nearest > 0) places[i].rank = nearest - 1;
    }
}

/// Edges across several ranks get a bend on each rank between.
void route(const Diagram& diagram, Layout& layout)
{
    for (const Edge& edge : diagram.edges) {
        std::vector<std::size_t> course{edge.from};
        const int last = layout.places[edge.to].rank;
        for (int rank = layout.places[edge.from].rank + 1; rank < last; ++rank) {
            Place bend;
            bend.width = 10.0;
            bend.rank = rank;
            course.push_back(layout.places.size());
            layout.places.push_back(bend);
        }
        course.push_back(edge.to);
        for (std::size_t k = 0; k + 1 < course.size(); ++k) {
            layout.places[course[k]].below.push_back(course[k + 1]);
            layout.places[course[k + 1]].above.push_back(course[k]);
        }
        layout.courses.push_back(std::move(course));
    }
    for (std::size_t i = 0; i < layout.places.size(); ++i) {
        const auto rank = static_cast<std::size_t>(layout.places[i].rank);
        if (layout.ranks.size() <= rank) layout.ranks.resize(rank + 1);
        layout.ranks[rank].push_back(i);
    }
}

std::vector<double> orders(const Layout& layout)
{
    std::vector<double> out(layout.places.size());
    for (const auto& rank : layout.ranks)
        for (std::size_t k = 0; k < rank.size(); ++k) out[rank[k]] = static_cast<double>(k);
    return out;
}

std::size_t crossings(const Layout& layout)
{
    const std::vector<double> order = orders(layout);
    std::size_t out = 0;
    for (const auto& rank : layout.ranks) {
        std::vector<std::pair<double, double>> lines;
        for (const std::size_t i : rank)
            for (const std::size_t j : layout.places[i].below)
                lines.emplace_back(order[i], order[j]);
        for (std::size_t a = 0; a < lines.size(); ++a)
            for (std::size_t b = a + 1; b < lines.size(); ++b)
                if ((lines[a].first - lines[b].first) * (lines[a].second - lines[b].second) < 0)
                    ++out;
    }
    return out;
}

/// Orders each rank by the mean place of its neighbours, down and up in turn, and keeps the order
/// with the fewest crossings.
void order_ranks(Layout& layout)
{
    auto best = layout.ranks;
    std::size_t fewest = crossings(layout);
    for (int sweep = 0; sweep < 12 && fewest > 0; ++sweep) {
        const bool down = sweep % 2 == 0;
        for (std::size_t k = 0; k < layout.ranks.size(); ++k) {
            auto& rank = layout.ranks[down ? k : layout.ranks.size() - 1 - k];
            const std::vector<double> order = orders(layout);
            std::map<std::size_t, double> mean;
            for (const std::size_t i : rank) {
                const auto& beside = down ? layout.places[i].above : layout.places[i].below;
                double sum = 0.0;
                for (const std::size_t j : beside) sum += order[j];
                mean[i] = beside.empty() ? order[i] : sum / static_cast<double>(beside.size());
            }
            std::stable_sort(rank.begin(), rank.end(),
                             [&](std::size_t a, std::size_t b) { return mean[a] < mean[b]; });
        }
        if (const std::size_t now = crossings(layout); now < fewest) {
            fewest = now;
            best = layout.ranks;
        }
    }
    layout.ranks = best;
}

/// Places one rank as near to `wanted` as order and gaps allow (least squares: neighbours that
/// would overlap are pooled and share their mean).
void place_rank(Layout& layout, const std::vector<std::size_t>& rank,
                const std::vector<double>& wanted)
{
    struct Pool {
        double sum;
        std::size_t count;
        double mean() const { return sum / static_cast<double>(count); }
    };
    std::vector<double> offset(rank.size(), 0.0);
    for (std::size_t k = 1; k < rank.size(); ++k)
        offset[k] = offset[k - 1] + box_gap +
                    0.5 * (layout.places[rank[k - 1]].width + layout.places[rank[k]].width);
    std::vector<Pool> pools;
    for (std::size_t k = 0; k < rank.size(); ++k) {
        pools.push_back({wanted[k] - offset[k], 1});
        while (pools.size() > 1 && pools[pools.size() - 2].mean() > pools.back().mean()) {
            const Pool last = pools.back();
            pools.pop_back();
            pools.back().sum += last.sum;
            pools.back().count += last.count;
        }
    }
    std::size_t k = 0;
    for (const Pool& pool : pools)
        for (std::size_t n = 0; n < pool.count; ++n, ++k)
            layout.places[rank[k]].x = pool.mean() + offset[k];
}

void place_columns(Layout& layout)
{
    for (const auto& rank : layout.ranks)
        place_rank(layout, rank, std::vector<double>(rank.size(), 0.0));
    constexpr int sweeps = 24;
    for (int sweep = 0; sweep < sweeps; ++sweep)
        for (std::size_t r = 0; r < layout.ranks.size(); ++r) {
            const auto& rank = layout.ranks[sweep % 2 == 0 ? r : layout.ranks.size() - 1 - r];
            std::vector<double> wanted;
            for (const std::size_t i : rank) {
                const Place& place = layout.places[i];
                double sum = 0.0;
                for (const std::size_t j : place.above) sum += layout.places[j].x;
                for (const std::size_t j : place.below) sum += layout.places[j].x;
                const std::size_t n = place.above.size() + place.below.size();
                wanted.push_back(n == 0 ? place.x : sum / static_cast<double>(n));
            }
            place_rank(layout, rank, wanted);
        }
    double left = 0.0;
    double right = 0.0;
    for (const Place& place : layout.places) {
        left = std::min(left, place.x - 0.5 * place.width);
        right = std::max(right, place.x + 0.5 * place.width);
    }
    for (Place& place : layout.places) place.x += margin - left;
    layout.width = right - left + 2.0 * margin;
}

void place_rows(Layout& layout, double top)
{
    double y = top;
    for (const auto& rank : layout.ranks) {
        double height = 0.0;
        for (const std::size_t i : rank) height = std::max(height, layout.places[i].height);
        for (const std::size_t i : rank) {
            Place& place = layout.places[i];
            if (place.height == 0.0) place.height = height;
            place.y = y + 0.5 * (height - place.height);
        }
        y += height + rank_gap;
    }
    layout.height = y - (layout.ranks.empty() ? 0.0 : rank_gap) + margin;
}

} // namespace

Layout make_layout(const Diagram& diagram, double top)
{
    Layout layout;
    for (const Box& box : diagram.boxes) layout.places.push_back(measure(box));
    // Labels stand side by side above a box; it is as wide as they are.
    std::vector<double> labels(diagram.boxes.size(), 0.0);
    for (const Edge& edge : diagram.edges)
        labels[edge.to] += edge.label.empty() ? 12.0 : label_width(edge);
    for (std::size_t i = 0; i < labels.size(); ++i)
        layout.places[i].width = std::max(layout.places[i].width, labels[i]);
    assign_ranks(diagram, layout.places);
    route(diagram, layout);
    order_ranks(layout);
    place_columns(layout);
    place_rows(layout, top);
    return layout;
}

} // namespace rayloom::diagram

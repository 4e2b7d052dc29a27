// SPDX-License-Identifier: Apache-2.0
/// \file
/// Where the boxes and edges of a diagram go: ranks from top to bottom, few crossings, short edges.
#pragma once

#include "rayloom/graph/diagram.h"

#include <cstddef>
#include <string>
#include <vector>

namespace rayloom::diagram
{

constexpr double line_height = 16.0; ///< of text in a box
constexpr double margin = 24.0;      ///< around the picture

/// Characters of a text.
std::size_t letters(const std::string& text);
/// Room an edge's label takes beside the other labels of the box it enters.
double label_width(const Edge& edge);

/// A box, or a bend of an edge that passes a rank.
struct Place {
    double width = 0.0, height = 0.0;
    double x = 0.0; ///< middle
    double y = 0.0; ///< top
    int rank = 0;
    std::vector<std::size_t> above, below; ///< neighbours on the ranks beside
};

struct Layout {
    std::vector<Place> places;                     ///< boxes first, then bends
    std::vector<std::vector<std::size_t>> ranks;   ///< places from left to right
    std::vector<std::vector<std::size_t>> courses; ///< of each edge: the places it passes
    double width = 0.0, height = 0.0;
};

/// Lays a diagram out below `top`.
Layout make_layout(const Diagram& diagram, double top);

} // namespace rayloom::diagram

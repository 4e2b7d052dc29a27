// SPDX-License-Identifier: Apache-2.0
/// \file
/// How far a pixel of the input can reach: what the plans of all nodes in a graph say they read.
#pragma once

#include "rayloom/engine/plan.h"

#include <map>
#include <string>
#include <vector>

namespace rayloom::test
{

/// Which pixels of a graph's outputs are made from which pixels of its inputs. What reductions read
/// is left out: a figure of the whole image must not spread one bad pixel over it.
class Reach
{
public:
    /// `box` holds the pixels, of every input, that reaches() asks for. Throws what make_plan()
    /// throws.
    Reach(const Graph& graph, const RunRequest& request, const Region& box = {});

    /// Whether a pixel of an image (or deep image) of an output may depend on them.
    bool reaches(const std::string& output, std::size_t image, int x, int y) const;

    using Regions = std::map<std::string, Region, std::less<>>;
    /// What of each input a pixel of an image of an output is made from.
    Regions read_for(const std::string& output, std::size_t image, int x, int y) const;

private:
    Plan m_plan;
    Region m_box;
    std::map<std::string, std::vector<int>, std::less<>> m_sinks; ///< items by output
};

} // namespace rayloom::test

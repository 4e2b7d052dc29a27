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

/// Which pixels of a graph's outputs are made from given pixels of its inputs. What reductions read
/// is left out: a figure of the whole image must not spread one bad pixel over it.
class Reach
{
public:
    /// The pixels are those inside `box`, of every input. Throws what make_plan() throws.
    Reach(const Graph& graph, const RunRequest& request, const Region& box);

    /// Whether a pixel of an image (or deep image) of an output may depend on them.
    bool reaches(const std::string& output, std::size_t image, int x, int y) const;

private:
    Plan m_plan;
    Region m_box;
    std::map<std::string, std::vector<int>, std::less<>> m_sinks; ///< items by output
};

} // namespace rayloom::test

// SPDX-License-Identifier: Apache-2.0
/// \file
/// Nodes with a deep output.
#pragma once

#include "rayloom/core/node.h"

#include <cstddef>

namespace rayloom
{

/// A reader of deep pixels: Node::read_deep_row() hands out its rows.
class DeepSource : public Node
{
public:
    /// Samples in its fullest row, for the memory budget; 0 when that cannot be told.
    virtual std::size_t row_samples() const = 0;
    void compute(const TileContext&) const final
    {
        throw Error("the rows of a deep source come from read_deep_row()");
    }
};

/// A node that makes a deep image out of its inputs. Its only output is deep.
class DeepNode : public Node
{
public:
    /// Row `y` of the output, over the width of its data window, with as many values in `samples`
    /// as the output's description names channels (and, after these, remainders of ids, see
    /// image/deep_rows.h). Inputs are there for what plan() needs of context.region(), which is
    /// whole rows, `y` among them. Called for any row from any thread.
    virtual DeepRow deep_row(const TileContext& context, int y) const = 0;
    void compute(const TileContext&) const final
    {
        throw Error("the rows of a deep output come from deep_row()");
    }
};

} // namespace rayloom

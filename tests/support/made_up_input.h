// SPDX-License-Identifier: Apache-2.0
/// \file
/// Plausible input for any graph, made from its declared inputs.
#pragma once

#include "rayloom/engine/request.h"
#include "rayloom/graph/model.h"

namespace rayloom::test
{

/// Binds every input of a graph to images in memory: channels as the input declares, lists of five
/// images, histograms (role or name `histogram`) of real samples, variances and counts that fit.
/// Throws Error for a kind of input it cannot make.
RunRequest made_up_request(const Graph& graph, const Region& window, unsigned seed = 1);

} // namespace rayloom::test

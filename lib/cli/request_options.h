// SPDX-License-Identifier: Apache-2.0
/// \file
/// The options `run` and `plan` share: which graph, inputs, outputs, parameters, and how to run.
#pragma once

#include "rayloom/engine/request.h"
#include "rayloom/graph/model.h"

#include <CLI/CLI.hpp>

#include <optional>
#include <string>
#include <vector>

namespace rayloom::cli
{

struct RequestOptions {
    std::string graph;
    std::vector<std::string> inputs, outputs, params;
    std::string frames, roi, memory, type, compression, cache;
    bool pass_through = false, no_skip = false;
    int threads = 0, tile = 0;

    void add_to(CLI::App& command);
    /// The frames of --frames; one without a number when it was not given.
    std::vector<std::optional<int>> frame_list() const;
    /// Inputs, outputs and parameters for one frame. Throws UsageError, InputError.
    RunRequest request(const Graph& graph, std::optional<int> frame) const;
    RunOptions run_options() const;
};

} // namespace rayloom::cli

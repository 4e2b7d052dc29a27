// SPDX-License-Identifier: Apache-2.0
/// \file
/// A JSON schema of graph files, for editors that complete and check as one types.
#pragma once

#include <string>

namespace rayloom
{

/// JSON schema (draft 2020-12) of graph files, made from the registered nodes: every op with its
/// inputs, parameters, ranges and descriptions. It accepts every graph the reader accepts; what
/// needs more than one place in the file (references, cycles, kinds) only the reader knows.
std::string graph_schema();

} // namespace rayloom

// SPDX-License-Identifier: Apache-2.0
/// \file
/// Texts about nodes, made from their declarations.
#pragma once

#include "rayloom/core/registry.h"

#include <string>

namespace rayloom
{

/// What `rayloom help OP` prints.
std::string node_help(const NodeInfo& node);
/// The node's page of the reference, Markdown.
std::string node_page(const NodeInfo& node);
/// The reference's first page: every node by stage with its summary.
std::string node_index(const std::vector<const NodeInfo*>& nodes);
/// "bool", "int from 1 to 6", "float at least 0, in px", "one of: a, b".
std::string param_summary(const ParamInfo& param);

} // namespace rayloom

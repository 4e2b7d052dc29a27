// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/error.h"

namespace rayloom
{

std::string SourcePosition::text() const
{
    std::string out = file;
    if (line > 0) out += (out.empty() ? "line " : ":") + std::to_string(line);
    if (line > 0 && column > 0) out += ":" + std::to_string(column);
    return out;
}

std::string Problem::text() const
{
    const std::string place = where.text();
    return place.empty() ? message : place + ": " + message;
}

namespace
{
std::string all_text(const std::vector<Problem>& problems)
{
    std::string out;
    for (const Problem& p : problems) out += (out.empty() ? "" : "\n") + p.text();
    return out;
}
} // namespace

GraphError::GraphError(std::vector<Problem> problems)
    : Error(all_text(problems)), m_problems(std::move(problems))
{
}

} // namespace rayloom

// SPDX-License-Identifier: Apache-2.0
/// \file
/// Planning and running one reading or writing node without an engine.
#pragma once

#include "rayloom/core/registry.h"
#include "tests/image/image_files.h"

#include <map>
#include <memory>
#include <string>
#include <vector>

namespace rayloom::test
{

/// Keeps what a node counted.
struct CountingServices final : RunServices {
    bool cancelled() const noexcept override { return false; }
    bool may_skip() const noexcept override { return true; }
    void count_skip(std::string_view, std::size_t) override {}
    void count(std::string_view what, std::size_t n) override { counts[std::string(what)] += n; }
    std::map<std::string, std::size_t> counts;
};

inline std::unique_ptr<Node> make(const char* op, const ParamValues& params)
{
    const NodeInfo* info = Registry::instance().find(op);
    return info == nullptr ? nullptr : info->create(params);
}

/// Computes one region of one output.
inline ImageBuffer fill(const Node& node, const char* port, const ImageDesc& desc,
                        const Region& region, std::size_t element = 0)
{
    ImageBuffer pixels(region, desc.channel_count());
    const TileContext::Output output{port, pixels.view()};
    CountingServices services;
    node.compute(TileContext(region, element, {}, {&output, 1}, services));
    return pixels;
}

inline std::string plan_message(const char* op, const ParamValues& params)
{
    const auto node = make(op, params);
    PlanContext context({});
    return message_of([&] { node->plan(context); });
}

inline float ramp(int x, int y, int c) { return static_cast<float>(x + 100 * y + 10000 * c); }

} // namespace rayloom::test

// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/deep_rows.h"

#include <algorithm>
#include <limits>

namespace rayloom
{

std::size_t deep_row_bytes(int width, int channels, std::size_t samples)
{
    return (static_cast<std::size_t>(width) + 1) * sizeof(std::uint32_t) +
           samples * static_cast<std::size_t>(channels) * sizeof(float);
}

bool deep_row_fits(const DeepRow& row, int width, int channels)
{
    return row.first.size() == static_cast<std::size_t>(width) + 1 && row.first.front() == 0 &&
           std::ranges::is_sorted(row.first) &&
           row.samples.size() >= static_cast<std::size_t>(channels) &&
           std::ranges::all_of(row.samples,
                               [&](const auto& c) { return c.size() == row.first.back(); });
}

DeepRow deep_columns(const DeepRow& row, int begin, int end)
{
    const std::uint32_t a = row.first[static_cast<std::size_t>(begin)],
                        b = row.first[static_cast<std::size_t>(end)];
    DeepRow part;
    for (int i = begin; i <= end; ++i)
        part.first.push_back(row.first[static_cast<std::size_t>(i)] - a);
    for (const auto& channel : row.samples)
        part.samples.emplace_back(channel.begin() + a, channel.begin() + b);
    return part;
}

void add_id_channel(DeepRow& row, std::span<const std::uint32_t> ids,
                    std::vector<std::vector<float>>& remainders)
{
    std::vector<float> values(ids.size()), rest(ids.size());
    for (std::size_t i = 0; i < ids.size(); ++i) {
        values[i] = static_cast<float>(ids[i]);
        rest[i] = static_cast<float>(static_cast<double>(ids[i]) - static_cast<double>(values[i]));
    }
    row.samples.push_back(std::move(values));
    remainders.push_back(std::move(rest));
}

std::uint32_t id_of(float value, float remainder)
{
    const double id = static_cast<double>(value) + static_cast<double>(remainder);
    if (!(id > 0.0)) return 0;
    constexpr double most = std::numeric_limits<std::uint32_t>::max();
    return static_cast<std::uint32_t>(std::min(id, most));
}

} // namespace rayloom

// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/deep_samples.h"

#include "rayloom/core/error.h"
#include "rayloom/core/text.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace rayloom
{

namespace
{

double share(float alpha) { return alpha > 0.0f ? std::min<double>(alpha, 1.0) : 0.0; }

bool nearer(float a, float b) { return std::isnan(b) ? !std::isnan(a) : a < b; }

float to_float(double v)
{
    constexpr double most = std::numeric_limits<float>::max();
    return static_cast<float>(std::isnan(v) ? v : std::clamp(v, -most, most));
}

} // namespace

void DeepVisibility::look(std::span<const float> alpha, std::span<const float> depth)
{
    m_order.resize(alpha.size());
    std::iota(m_order.begin(), m_order.end(), 0u);
    if (!depth.empty() && !std::is_sorted(depth.begin(), depth.end(), nearer))
        std::stable_sort(m_order.begin(), m_order.end(), [&](std::uint32_t a, std::uint32_t b) {
            return nearer(depth[a], depth[b]);
        });
    m_transmittance.resize(alpha.size());
    m_coverage = 0.0;
    double open = 1.0;
    for (const std::uint32_t i : m_order) {
        m_transmittance[i] = open;
        const double kept = open * share(alpha[i]);
        m_coverage += kept;
        open -= kept;
    }
}

double DeepVisibility::flatten(std::span<const float> values) const
{
    double sum = 0.0;
    for (const std::uint32_t i : m_order) {
        if (m_transmittance[i] <= 0.0) break;
        sum += m_transmittance[i] * values[i];
    }
    return sum;
}

void recolor_samples(const DeepVisibility& seen, std::span<const float> alpha,
                     std::span<const float> was, double target, double max_gain,
                     std::span<float> out)
{
    const double flat = was.empty() ? 0.0 : seen.flatten(was);
    const double covered = seen.coverage();
    double gain = 0.0;
    if (std::isfinite(flat) && flat != 0.0 && target / flat > 0.0)
        gain =
            std::min(target / flat, covered > 0.0 ? max_gain : std::numeric_limits<double>::max());
    const double missing = gain > 0.0 ? target - gain * flat : target;
    for (std::size_t i = 0; i < out.size(); ++i) {
        const double old = gain > 0.0 && std::isfinite(was[i]) ? gain * was[i] : 0.0;
        const double more = covered > 0.0 ? share(alpha[i]) * missing / covered
                                          : (i == seen.front() ? missing : 0.0);
        out[i] = to_float(old + more);
    }
}

int require_deep_alpha(const ImageDesc& deep)
{
    const int alpha = deep.alpha();
    if (alpha < 0)
        throw NodeError("input 'deep' has no alpha channel (A), which says how far each sample "
                        "covers those behind it; it has " +
                        join_names(deep.channels));
    return alpha;
}

std::vector<int> deep_colour(const ImageDesc& image)
{
    std::vector<int> channels = image.colour();
    std::erase_if(channels, [&](int c) {
        const std::string& name = image.channels[static_cast<std::size_t>(c)];
        return name == "Z" || name == "ZBack";
    });
    return channels;
}

} // namespace rayloom

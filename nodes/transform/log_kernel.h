// SPDX-License-Identifier: Apache-2.0
/// \file
/// Natural logarithm and exponential of float rows: polynomials in plain operations, so that loops
/// over them vectorise and give the same bits on every target.
#pragma once

#include <bit>
#include <cstdint>

namespace rayloom
{

/// ln x for normal x > 0; absolute error ≤ 1e-7 + 1e-7 |ln x|.
inline float log_of(float x)
{
    // x = m 2^e with m in [√½, √2); ln m = 2 atanh((m − 1)/(m + 1)).
    const auto bits = std::bit_cast<std::int32_t>(x);
    const std::int32_t e = (bits - 0x3f3504f3) >> 23;
    const float m = std::bit_cast<float>(bits - e * (1 << 23));
    const float s = (m - 1.0f) / (m + 1.0f);
    const float z = s * s;
    const float series = z * (0.66666667f + z * (0.4f + z * (0.28571429f + z * 0.22222222f)));
    const float exponent = static_cast<float>(e);
    // ln 2 in two parts, the first short enough for e·ln 2 to be exact.
    return exponent * 0.693359375f + (2.0f * s + (s * series + exponent * -2.12194440e-4f));
}

/// e^y; relative error ≤ 2e-7 for |y| ≤ 80. Beyond ±87 the value at ±87.
inline float exp_of(float y)
{
    y = y < -87.0f ? -87.0f : y;
    y = y > 87.0f ? 87.0f : y;
    // Adding 1.5·2²³ rounds to the nearest integer.
    const float shifted = y * 1.44269504f + 12582912.0f;
    const float k = shifted - 12582912.0f;
    const float r = (y - k * 0.693359375f) - k * -2.12194440e-4f;
    const float p =
        1.0f +
        r * (1.0f + r * (0.5f + r * (0.16666667f + r * (0.041666668f +
                                                        r * (0.0083333338f + r * 0.0013888889f)))));
    const std::int32_t power = (static_cast<std::int32_t>(k) + 127) * (1 << 23);
    return p * std::bit_cast<float>(power);
}

} // namespace rayloom

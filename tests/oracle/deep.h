// SPDX-License-Identifier: Apache-2.0
/// \file
/// Deep pixels flattened and recoloured as the equations say, in double.
#pragma once

#include <cstddef>
#include <vector>

namespace rayloom::oracle
{

/// One sample: premultiplied value of one channel, alpha in 0..1, depth.
struct DeepSample {
    double value, alpha, depth;
};

/// Samples over one another, nearest first. Sorted by repeated search of the nearest.
inline double flatten(std::vector<DeepSample> samples)
{
    double sum = 0.0, behind = 1.0;
    while (!samples.empty()) {
        std::size_t near = 0;
        for (std::size_t i = 1; i < samples.size(); ++i)
            if (samples[i].depth < samples[near].depth) near = i;
        sum += behind * samples[near].value;
        behind *= 1.0 - samples[near].alpha;
        samples.erase(samples.begin() + static_cast<std::ptrdiff_t>(near));
    }
    return sum;
}

/// Alpha of the pixel: 1 minus what all samples let through.
inline double coverage(const std::vector<DeepSample>& samples)
{
    double through = 1.0;
    for (const DeepSample& s : samples) through *= 1.0 - s.alpha;
    return 1.0 - through;
}

/// New values of the samples, in the order given, for a pixel with coverage: g v + α (C − g F) / A.
inline std::vector<double> recolor(const std::vector<DeepSample>& samples, double target,
                                   double max_gain)
{
    const double flat = flatten(samples), covered = coverage(samples);
    double gain = flat == 0.0 ? 0.0 : target / flat;
    if (gain < 0.0) gain = 0.0;
    if (gain > max_gain) gain = max_gain;
    std::vector<double> values;
    for (const DeepSample& s : samples)
        values.push_back(gain * s.value + s.alpha * (target - gain * flat) / covered);
    return values;
}

} // namespace rayloom::oracle

// SPDX-License-Identifier: Apache-2.0
/// \file
/// Non-local means over homogeneous pixels, written plainly from 000_092f36e585912bb0.txt, eq. (1)
/// and (2): every pair and every pixel of every patch. Slow on purpose. `Real` is double for the
/// oracle and float for the plain version speed is compared with.
#pragma once

#include "rayloom/image/view.h"

#include <cstddef>
#include <span>
#include <vector>

namespace rayloom::oracle
{

struct NlmFrame {
    ConstImageView image, guide, guide_variance, low, high; ///< over the whole window
};

enum class NlmGate { none, one_sample, two_sample };

struct NlmSettings {
    int window = 31, patch = 5, patch_frames = 1; ///< sides
    double sigma_s = 31.0 / 3.0;
    double range = 1.0;
    NlmGate gate = NlmGate::two_sample;
};

template <class Real>
struct NlmResult {
    std::vector<Real> pixels;    ///< [channel][y][x]
    std::vector<Real> variances; ///< Σ w²·V/(Σ w)² for V = 1
    /// Whether a gate of the pixel hangs on rounding, so that float may decide otherwise.
    std::vector<bool> ambiguous;
};

/// Filters the pixels of `part` in frame `centre`, channel by channel of `image`; the gate looks
/// at all of them.
template <class Real>
NlmResult<Real> filter_nlm(std::span<const NlmFrame> frames, std::size_t centre,
                           const NlmSettings& settings, const Region& part);

} // namespace rayloom::oracle

// SPDX-License-Identifier: Apache-2.0
/// \file
/// Non-local means over a guide, on planar float pixels.
///
/// For pixel p of the current frame and each pixel q ≠ p of the window around it:
///
///     d(p, q) = Σ_δ G(δ) · mean over guide channels of (F(q+δ) − F(p+δ))²,   Σ G = 1
///     w(p, q) = a(p, q) · exp(−d / (2 σ_r²) − |q − p|² / (2 σ_s²)),   w(p, p) = 1
///     D(p)    = Σ_q w(p, q) · N(q) / Σ_q w(p, q)
///
/// with σ_r² the smaller of the range variances of p and q and a ∈ {0, 1} the gate. A weight below
/// 2⁻¹¹⁵ is zero. The patch distance is symmetric, so within the current frame one evaluation
/// serves both pixels.
#pragma once

#include "rayloom/image/view.h"

#include <cstddef>
#include <span>
#include <vector>

namespace rayloom
{

/// Which pixels of the window may be averaged.
enum class NlmGate {
    none,       ///< all
    one_sample, ///< q when low(p) ≤ x(q) ≤ high(p) in every channel
    two_sample, ///< q when (x(p) − x(q))² ≤ h²(p) + h²(q) in every channel
};

struct NlmSettings {
    int window_radius = 15;
    int patch_radius = 2;
    float sigma_s = 31.0f / 3.0f; ///< px; a frame counts as one pixel
    NlmGate gate = NlmGate::two_sample;
};

/// Weights of one row or column of a patch, [2·radius + 1], sum 1: a Gaussian with
/// σ = (2·radius + 1) / 3.
std::vector<float> nlm_patch_weights(int radius);

/// Neighbouring offsets of one row of the window that are worked on together, so that what they
/// share is loaded once and their rows stay in the first-level cache.
constexpr int nlm_group_size = 8;
/// Rows whose patch distances are summed along columns together: what lies in the second-level
/// cache is loaded once for all of them.
constexpr int nlm_column_rows = 4;

/// log₂ e: weights are computed as powers of two.
constexpr float nlm_log2_e = 1.44269504f;

/// What every plane of NlmFrame must cover: `region` with its window, patches and padding.
Region nlm_plane_region(const Region& region, const NlmSettings& settings);
/// What NlmJob::sums must cover; only `region` is meaningful afterwards.
Region nlm_sums_region(const Region& region);
/// Memory nlm_sums() takes for itself.
std::size_t nlm_scratch_bytes(const Region& region, const NlmSettings& settings);

/// Planes of one frame, each over nlm_plane_region(). Pixels outside the image: `guide` continues
/// it in whatever way patches are to see it, `inverse` is infinite, the rest is finite. The planes
/// have the channel stride of one buffer.
struct NlmFrame {
    ConstImageView guide;    ///< divided by the root of its number of channels
    ConstImageView inverse;  ///< log₂ e / (2 σ_r²)
    ConstImageView image;    ///< the channels to average
    ConstImageView tested;   ///< with a gate: x
    ConstImageView low;      ///< one-sample gate
    ConstImageView high;     ///< one-sample gate
    ConstImageView spread;   ///< two-sample gate: h²
    ConstImageView variance; ///< empty, or the variance of `image`, channel by channel
    int distance = 0;        ///< frames from the current one
};

struct NlmJob {
    Region region; ///< pixels to compute
    Region window; ///< the image's data window
    NlmSettings settings;
    std::span<const NlmFrame> frames; ///< the current one first
    /// Receives Σ w·N per image channel, Σ w, and Σ w²·V per variance channel.
    ImageView sums;
};

/// Fills job.sums. The bits of a pixel depend neither on the region nor on the SIMD target.
void nlm_sums(const NlmJob& job);

/// 2^−x for x ≥ 0 as the kernel computes it; relative error below 3e-7, 0 from 115 on.
void nlm_power_of_two_negative(std::span<const float> x, std::span<float> result);

} // namespace rayloom

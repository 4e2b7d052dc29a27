// SPDX-License-Identifier: Apache-2.0
/// \file
/// What `rayloom compare A B [--ref R]` says, as a library call.
#pragma once

#include "rayloom/stats/error_measures.h"

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace rayloom
{

/// Measures of A against B; or, with a reference, of A and of B against it.
struct Comparison {
    ErrorMeasures a;
    std::optional<ErrorMeasures> b; ///< set when there is a reference

    /// How many times the samples of B it would take to bring B to the error of A, if the squared
    /// error of B falls as 1 / samples: relMSE(B) / relMSE(A). NaN without a reference; +∞ when A
    /// is the reference.
    double equal_error_sample_factor() const;

    /// Without a reference one object of figures. With one: {"a": {…}, "b": {…}, "a_over_b": {…},
    /// "psnr_gain": dB, "equal_error_sample_factor": n}, where "a_over_b" holds the ratio of every
    /// figure that is an error (below 1: A is better). Infinities are null.
    std::string json() const;
    /// The same for people: a line a figure, ending in a newline.
    std::string text() const;
};

/// Both images and the reference must have the same region and 1 or 3 channels (linear radiance).
/// Throws InputError otherwise.
Comparison compare_images(ConstImageView a, ConstImageView b, const ErrorOptions& options = {});
Comparison compare_images(ConstImageView a, ConstImageView b, ConstImageView reference,
                          const ErrorOptions& options = {});

/// The worst value of a measure that still passes.
struct ErrorLimit {
    std::string measure;
    double value = 0.0;
};
/// Reads "flip=0.05": psnr, psnr_clamped and ssim are lower limits, the rest upper ones. Throws
/// UsageError that lists the measures.
ErrorLimit parse_error_limit(std::string_view text);
/// One line for each limit that does not hold; a measure without a value breaks its limit. Pixels
/// that are not finite, which no measure sees, break any unless they have a limit of their own.
std::vector<std::string> broken_limits(const ErrorMeasures& measures,
                                       std::span<const ErrorLimit> limits);

/// An error map to look at.
struct ErrorPicture {
    ImageBuffer srgb; ///< three sRGB-encoded channels in [0, 1]
    double high = 1;  ///< error shown in the brightest colour; 0 is the darkest
};
/// FLIP maps show 0 … 1; the others 0 … the error that 99.5 % of the pixels do not exceed, so that
/// one fire-fly does not darken everything else.
ErrorPicture error_picture(ConstImageView image, ConstImageView reference, ErrorMap map,
                           const ErrorOptions& options = {});

} // namespace rayloom

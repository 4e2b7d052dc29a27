// SPDX-License-Identifier: Apache-2.0
/// \file
/// How far a picture is from its reference. Definitions and constants: docs/measures.md.
#pragma once

#include "rayloom/core/table.h"
#include "rayloom/stats/flip.h"
#include "rayloom/stats/image_pair.h"
#include "rayloom/stats/ssim.h"

#include <cstddef>
#include <limits>
#include <optional>
#include <span>

namespace rayloom
{

/// What to measure beyond the pixelwise figures, and how.
struct ErrorOptions {
    bool ssim = true;
    bool flip = true;
    bool hdr_flip = true; ///< costs one FLIP an exposure, often five to twelve
    double pixels_per_degree = flip_pixels_per_degree; ///< of FLIP
    ToneMapper tone_mapper = ToneMapper::aces;         ///< of HDR-FLIP; not `none`
    std::optional<ExposureRange> exposures;            ///< of HDR-FLIP; else flip_exposures()
};

/// Every figure of an image d against a reference r. A figure that was not asked for, or that has
/// no value (SSIM of a picture smaller than its window), is NaN.
struct ErrorMeasures {
    static constexpr double none = std::numeric_limits<double>::quiet_NaN();

    std::size_t pixels = 0;            ///< pixels that count
    std::size_t non_finite_pixels = 0; ///< left out: NaN or infinite in d or in r
    double rmse = none;                ///< √mean (d−r)²
    double relmse = none;              ///< mean (d−r)²/(r²+0.01)
    double relmse_trimmed = none;      ///< relMSE without the worst 0.1 % of pixels
    double psnr = none;                ///< 10·log₁₀(1/mean (d−r)²), dB; +∞ when equal
    double psnr_clamped = none;        ///< PSNR after clamping d and r to [0, 1]
    double smape = none;               ///< mean |d−r|/(|d|+|r|+0.01), in [0, 1]
    double max_abs_error = none;       ///< largest |d−r|
    double brightness_ratio = none;    ///< mean luminance of d over that of r
    double ssim = none;                ///< mean SSIM
    double flip = none;                ///< mean LDR-FLIP
    double hdr_flip = none;            ///< mean HDR-FLIP
    ExposureRange hdr_flip_exposures;  ///< what hdr_flip was made with

    /// One row, a column a figure; those without a value are left out.
    Table table() const;
};

/// A picture of the error, one value a pixel.
enum class ErrorMap {
    absolute, ///< |d−r|, mean over channels
    relative, ///< (d−r)²/(r²+0.01), mean over channels
    flip,     ///< LDR-FLIP
    hdr_flip, ///< HDR-FLIP (of error_map() only: it needs the whole reference)
};

/// Measures row by row, for callers that never hold a whole image. Every figure but HDR-FLIP and
/// the trimmed relMSE is made from sums over rows.
class ErrorMeter
{
public:
    /// Numbers a row contributes.
    static constexpr std::size_t sum_count = 13;

    /// Throws NodeError when pixels_per_degree is out of [1, 1000].
    explicit ErrorMeter(const ErrorOptions& options);

    /// Rows above and below that add_row() reads (clipped to the window).
    int halo_rows() const;
    /// Adds rows [y0, y1) of the pair, sum_count numbers a row, to `sums`, which holds a record of
    /// sum_count zeros per row. A row's record does not depend on which rows it is asked with.
    void add_rows(const ImagePair& pair, int y0, int y1, std::span<double> sums) const;
    /// Adds the record of other rows.
    static void combine(std::span<double> into, std::span<const double> other);
    /// Pixels of a record's rows that were left out.
    static std::size_t left_out(std::span<const double> record);
    /// The figures of the rows whose records were combined.
    ErrorMeasures measures(std::span<const double> totals, int channels) const;

    /// Pixels a map reads beyond the pixel it writes.
    int map_halo(ErrorMap map) const;
    /// Fills channel 0 of `out` over out.region(). Pixels that are not finite get 0. `map` is not
    /// hdr_flip.
    void map(const ImagePair& pair, ErrorMap map, ImageView out) const;

private:
    ErrorOptions m_options;
    Ssim m_ssim;
    Flip m_flip;
};

/// All measures of whole images, in parallel; the same bits for any number of threads. The images
/// must have 1 or 3 channels (as many in both) and the same region. Throws InputError otherwise,
/// and where every pixel is left out.
ErrorMeasures measure_errors(ConstImageView image, ConstImageView reference,
                             const ErrorOptions& options = {});

/// An error map of whole images, in parallel: one channel over image.region().
ImageBuffer error_map(ConstImageView image, ConstImageView reference, ErrorMap map,
                      const ErrorOptions& options = {});

} // namespace rayloom

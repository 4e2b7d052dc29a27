// SPDX-License-Identifier: Apache-2.0
#include "rayloom/simd/row_filters.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "lib/simd/row_filters.cpp"
#include <hwy/foreach_target.h>

#include "rayloom/simd/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace rayloom
{
namespace HWY_NAMESPACE
{
namespace
{
using namespace simd::HWY_NAMESPACE;

/// Stores pixel(d, i) at out + i: whole vectors, then single lanes with the same operations.
template <class Pixel>
HWY_INLINE void ForRow(std::size_t n, float* HWY_RESTRICT out, const Pixel& pixel)
{
    const D d;
    const hn::CappedTag<float, 1> one;
    const std::size_t lanes = hn::Lanes(d);
    std::size_t i = 0;
    for (; i + lanes <= n; i += lanes) hn::StoreU(pixel(d, i), d, out + i);
    for (; i < n; ++i) hn::StoreU(pixel(one, i), one, out + i);
}

struct Mean {
    const float *a, *b, *c, *d;
    template <class D>
    HWY_INLINE hn::Vec<D> operator()(D tag, std::size_t i) const
    {
        const auto sum = hn::Add(hn::Add(hn::LoadU(tag, a + i), hn::LoadU(tag, b + i)),
                                 hn::Add(hn::LoadU(tag, c + i), hn::LoadU(tag, d + i)));
        return hn::Mul(hn::Set(tag, 0.25f), sum);
    }
};

struct Difference {
    const float *plus, *minus;
    float gain;
    template <class D>
    HWY_INLINE hn::Vec<D> operator()(D tag, std::size_t i) const
    {
        return hn::Mul(hn::Set(tag, gain),
                       hn::Sub(hn::LoadU(tag, plus + i), hn::LoadU(tag, minus + i)));
    }
};

struct BinomialRest {
    const float *above, *here, *below;
    template <class D>
    HWY_INLINE hn::Vec<D> operator()(D tag, std::size_t i) const
    {
        const auto two = hn::Set(tag, 2.0f);
        const auto column = [&](std::ptrdiff_t x) HWY_ATTR {
            return hn::Add(hn::Add(hn::LoadU(tag, above + x), hn::LoadU(tag, below + x)),
                           hn::Mul(two, hn::LoadU(tag, here + x)));
        };
        const auto x = static_cast<std::ptrdiff_t>(i);
        const auto sum = hn::Add(hn::Add(column(x - 1), column(x + 1)), hn::Mul(two, column(x)));
        return hn::Sub(hn::LoadU(tag, here + i), hn::Mul(hn::Set(tag, 0.0625f), sum));
    }
};

struct Spline {
    const float *a, *b, *c, *d, *e;
    template <class D>
    HWY_INLINE hn::Vec<D> operator()(D tag, std::size_t i) const
    {
        const auto outer = hn::Add(hn::LoadU(tag, a + i), hn::LoadU(tag, e + i));
        const auto inner = hn::Add(hn::LoadU(tag, b + i), hn::LoadU(tag, d + i));
        return hn::Add(hn::Mul(hn::Set(tag, 0.0625f), outer),
                       hn::Add(hn::Mul(hn::Set(tag, 0.25f), inner),
                               hn::Mul(hn::Set(tag, 0.375f), hn::LoadU(tag, c + i))));
    }
};

struct Frame {
    const FrameRow& taps;
    template <class D>
    HWY_INLINE hn::Vec<D> operator()(D tag, std::size_t i) const
    {
        const auto differences = [&](const std::array<const float*, 4>& t) HWY_ATTR {
            return hn::Add(hn::Sub(hn::LoadU(tag, t[0] + i), hn::LoadU(tag, t[1] + i)),
                           hn::Sub(hn::LoadU(tag, t[2] + i), hn::LoadU(tag, t[3] + i)));
        };
        const auto sum =
            hn::Add(hn::Add(hn::LoadU(tag, taps.low[0] + i), hn::LoadU(tag, taps.low[1] + i)),
                    hn::Add(hn::LoadU(tag, taps.low[2] + i), hn::LoadU(tag, taps.low[3] + i)));
        return hn::Add(
            hn::Mul(hn::Set(tag, 0.25f), sum),
            hn::Add(hn::Mul(hn::Set(tag, taps.upright_gain), differences(taps.upright)),
                    hn::Mul(hn::Set(tag, taps.slanted_gain), differences(taps.slanted))));
    }
};

struct AddLow {
    const float *high, *above, *here;
    template <class D>
    HWY_INLINE hn::Vec<D> operator()(D tag, std::size_t i) const
    {
        const auto pair = [&](const float* row) HWY_ATTR {
            return hn::Add(hn::LoadU(tag, row + i - 1), hn::LoadU(tag, row + i));
        };
        return hn::Add(hn::LoadU(tag, high + i),
                       hn::Mul(hn::Set(tag, 0.25f), hn::Add(pair(above), pair(here))));
    }
};

void MeanRow(const float* a, const float* b, const float* c, const float* d, float* out,
             std::size_t n)
{
    ForRow(n, out, Mean{a, b, c, d});
}
void DifferenceRow(const float* plus, const float* minus, float gain, float* out, std::size_t n)
{
    ForRow(n, out, Difference{plus, minus, gain});
}
void BinomialRestRow(const float* above, const float* here, const float* below, float* out,
                     std::size_t n)
{
    ForRow(n, out, BinomialRest{above, here, below});
}
void SplineRow(const float* a, const float* b, const float* c, const float* d, const float* e,
               float* out, std::size_t n)
{
    ForRow(n, out, Spline{a, b, c, d, e});
}
void FrameRows(const FrameRow& taps, float* out, std::size_t n) { ForRow(n, out, Frame{taps}); }
void AddLowRow(const float* high, const float* above, const float* here, float* out, std::size_t n)
{
    ForRow(n, out, AddLow{high, above, here});
}

} // namespace
} // namespace HWY_NAMESPACE
} // namespace rayloom
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace rayloom
{

HWY_EXPORT(MeanRow);
HWY_EXPORT(DifferenceRow);
HWY_EXPORT(BinomialRestRow);
HWY_EXPORT(SplineRow);
HWY_EXPORT(FrameRows);
HWY_EXPORT(AddLowRow);

void mean_of_four_row(const float* a, const float* b, const float* c, const float* d, float* out,
                      std::size_t n)
{
    HWY_DYNAMIC_DISPATCH(MeanRow)(a, b, c, d, out, n);
}
void difference_row(const float* plus, const float* minus, float gain, float* out, std::size_t n)
{
    HWY_DYNAMIC_DISPATCH(DifferenceRow)(plus, minus, gain, out, n);
}
void binomial_rest_row(const float* above, const float* here, const float* below, float* out,
                       std::size_t n)
{
    HWY_DYNAMIC_DISPATCH(BinomialRestRow)(above, here, below, out, n);
}
void spline_row(const float* a, const float* b, const float* c, const float* d, const float* e,
                float* out, std::size_t n)
{
    HWY_DYNAMIC_DISPATCH(SplineRow)(a, b, c, d, e, out, n);
}
void frame_row(const FrameRow& taps, float* out, std::size_t n)
{
    HWY_DYNAMIC_DISPATCH(FrameRows)(taps, out, n);
}
void add_low_row(const float* high, const float* above, const float* here, float* out,
                 std::size_t n)
{
    HWY_DYNAMIC_DISPATCH(AddLowRow)(high, above, here, out, n);
}

} // namespace rayloom
#endif

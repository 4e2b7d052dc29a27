// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/separable.h"

#include <cassert>
#include <cstdint>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "lib/stats/separable.cpp"
#include <hwy/foreach_target.h>

#include "rayloom/simd/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace rayloom
{
namespace HWY_NAMESPACE
{
using namespace simd::HWY_NAMESPACE;

template <bool odd>
HWY_ATTR double one_pixel(const double* const* rows, const double* w, std::size_t r, std::size_t i)
{
    double sum = odd ? 0.0 : w[0] * rows[r][i];
    for (std::size_t k = 1; k <= r; ++k) {
        const double after = rows[r + k][i], before = rows[r - k][i];
        sum = sum + w[k] * (odd ? after - before : after + before);
    }
    return sum;
}

template <bool odd>
HWY_ATTR void weighted_rows(const double* const* rows, const double* w, std::size_t r, double* out,
                            std::size_t n)
{
    const hn::ScalableTag<double> d;
    const std::size_t lanes = hn::Lanes(d);
    std::size_t i = 0;
    // Two vectors at a time hide the latency of the additions.
    for (; i + 2 * lanes <= n; i += 2 * lanes) {
        auto a = hn::Zero(d), b = hn::Zero(d);
        if (!odd) {
            const auto weight = hn::Set(d, w[0]);
            a = hn::Mul(weight, hn::LoadU(d, rows[r] + i));
            b = hn::Mul(weight, hn::LoadU(d, rows[r] + i + lanes));
        }
        for (std::size_t k = 1; k <= r; ++k) {
            const auto weight = hn::Set(d, w[k]);
            const double* after = rows[r + k] + i;
            const double* before = rows[r - k] + i;
            const auto a1 = hn::LoadU(d, after), a0 = hn::LoadU(d, before);
            const auto b1 = hn::LoadU(d, after + lanes), b0 = hn::LoadU(d, before + lanes);
            a = hn::Add(a, hn::Mul(weight, odd ? hn::Sub(a1, a0) : hn::Add(a1, a0)));
            b = hn::Add(b, hn::Mul(weight, odd ? hn::Sub(b1, b0) : hn::Add(b1, b0)));
        }
        hn::StoreU(a, d, out + i);
        hn::StoreU(b, d, out + i + lanes);
    }
    for (; i < n; ++i) out[i] = one_pixel<odd>(rows, w, r, i);
}

HWY_ATTR void even_rows(const double* const* rows, const double* w, std::size_t r, double* out,
                        std::size_t n)
{
    weighted_rows<false>(rows, w, r, out, n);
}
HWY_ATTR void odd_rows(const double* const* rows, const double* w, std::size_t r, double* out,
                       std::size_t n)
{
    weighted_rows<true>(rows, w, r, out, n);
}

} // namespace HWY_NAMESPACE
} // namespace rayloom
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace rayloom
{

HWY_EXPORT(even_rows);
HWY_EXPORT(odd_rows);

void weighted_row_sum(std::span<const double* const> rows, std::span<const double> w, Parity parity,
                      double* out, std::size_t n)
{
    assert(!w.empty() && rows.size() == 2 * w.size() - 1);
    const std::size_t r = w.size() - 1;
    if (parity == Parity::even)
        HWY_DYNAMIC_DISPATCH(even_rows)(rows.data(), w.data(), r, out, n);
    else
        HWY_DYNAMIC_DISPATCH(odd_rows)(rows.data(), w.data(), r, out, n);
}

} // namespace rayloom
#endif

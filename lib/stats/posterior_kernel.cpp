// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/posterior_kernel.h"

#include <boost/math/quadrature/gauss_kronrod.hpp>

#include <algorithm>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "lib/stats/posterior_kernel.cpp"
#include <hwy/foreach_target.h>

#include "rayloom/simd/lanes-inl.h"

#ifndef RAYLOOM_POSTERIOR_RULE
#define RAYLOOM_POSTERIOR_RULE
namespace rayloom
{
namespace
{

/// Abscissae of the rule and its weights; the sixteenth point has none.
struct Rule {
    std::array<double, 16> x{}, kronrod{}, gauss{};

    Rule()
    {
        using boost::math::quadrature::gauss;
        using boost::math::quadrature::gauss_kronrod;
        const auto& at = gauss_kronrod<double, 15>::abscissa();
        const auto& k = gauss_kronrod<double, 15>::weights();
        const auto& g = boost::math::quadrature::gauss<double, 7>::weights();
        kronrod[0] = k[0];
        this->gauss[0] = g[0];
        for (std::size_t i = 1; i < at.size(); ++i)
            for (const std::size_t side : {2 * i - 1, 2 * i}) {
                x[side] = side == 2 * i ? at[i] : -at[i];
                kronrod[side] = k[i];
                this->gauss[side] = i % 2 == 0 ? g[i / 2] : 0.0;
            }
    }
};
const Rule& rule()
{
    static const Rule r;
    return r;
}

} // namespace
} // namespace rayloom
#endif

HWY_BEFORE_NAMESPACE();
namespace rayloom
{
namespace HWY_NAMESPACE
{
namespace
{
using namespace simd::HWY_NAMESPACE;

using DD = hn::CappedTag<double, 16>;
using VD = hn::Vec<DD>;
/// 1.5·2⁵²: added to a double of moderate size it leaves the nearest integer in the low bits.
constexpr double round_to_integer = 6755399441055744.0;

/// ln x for normal x > 0.
HWY_INLINE VD Log(VD x)
{
    const DD d;
    const hn::RebindToSigned<DD> di;
    // x = m 2^e with m in [√½, √2); ln m = 2 atanh((m − 1)/(m + 1)).
    const auto bits = hn::BitCast(di, x);
    const auto e = hn::ShiftRight<52>(hn::Sub(bits, hn::Set(di, 0x3fe6a09e667f3bcdLL)));
    const VD m = hn::BitCast(d, hn::Sub(bits, hn::ShiftLeft<52>(e)));
    const VD exponent =
        hn::Sub(hn::BitCast(d, hn::Add(e, hn::BitCast(di, hn::Set(d, round_to_integer)))),
                hn::Set(d, round_to_integer));
    const VD one = hn::Set(d, 1.0);
    const VD s = hn::Div(hn::Sub(m, one), hn::Add(m, one));
    const VD z = hn::Mul(s, s);
    VD series = hn::Set(d, 1.0 / 17.0);
    for (const double odd : {15.0, 13.0, 11.0, 9.0, 7.0, 5.0, 3.0, 1.0})
        series = hn::Add(hn::Mul(series, z), hn::Set(d, 1.0 / odd));
    return hn::Add(hn::Mul(exponent, hn::Set(d, 0.69314718055994530942)),
                   hn::Mul(hn::Add(s, s), series));
}

/// e^x, kept within e^±700.
HWY_INLINE VD Exp(VD x)
{
    const DD d;
    const hn::RebindToSigned<DD> di;
    x = hn::Min(hn::Max(x, hn::Set(d, -700.0)), hn::Set(d, 700.0));
    const VD shifted =
        hn::Add(hn::Mul(x, hn::Set(d, 1.4426950408889634074)), hn::Set(d, round_to_integer));
    const VD k = hn::Sub(shifted, hn::Set(d, round_to_integer));
    // ln 2 in two parts, the first short enough for k·ln 2 to be exact.
    const VD r = hn::Sub(hn::Sub(x, hn::Mul(k, hn::Set(d, 0.693147180369123816490))),
                         hn::Mul(k, hn::Set(d, 1.90821492927058770002e-10)));
    VD p = hn::Set(d, 1.0 / 39916800.0);
    for (const double factorial :
         {3628800.0, 362880.0, 40320.0, 5040.0, 720.0, 120.0, 24.0, 6.0, 2.0, 1.0, 1.0})
        p = hn::Add(hn::Mul(p, r), hn::Set(d, 1.0 / factorial));
    const auto power = hn::ShiftLeft<52>(hn::Add(hn::BitCast(di, shifted), hn::Set(di, 1023)));
    return hn::Mul(p, hn::BitCast(d, power));
}

HWY_INLINE VD Power(VD x, double p)
{
    const DD d;
    return Exp(hn::Mul(hn::Set(d, p), Log(hn::Max(x, hn::Set(d, 1e-300)))));
}

HWY_INLINE VD ExponentAt(const PosteriorExponent& g, VD c)
{
    const DD d;
    const VD signal = Power(hn::Mul(hn::Abs(c), hn::Set(d, g.inverse_a)), g.signal_p);
    const VD noise = Power(hn::Abs(hn::Sub(hn::Set(d, g.y), c)), g.noise_p);
    return hn::Neg(hn::Add(signal, noise));
}

void Exponents(const PosteriorExponent& g, const double* c, double* out, std::size_t n)
{
    const DD d;
    const std::size_t lanes = hn::Lanes(d);
    HWY_ALIGN double padded[16] = {};
    for (std::size_t i = 0; i < n; i += lanes) {
        const std::size_t m = std::min(lanes, n - i);
        std::copy_n(c + i, m, padded);
        hn::Store(ExponentAt(g, hn::Load(d, padded)), d, padded);
        std::copy_n(padded, m, out + i);
    }
}

void IntervalSums(const PosteriorExponent& g, double peak, const Rule& rule, double middle,
                  double half, double* sums)
{
    const DD d;
    HWY_ALIGN double c[16], e[16];
    for (std::size_t i = 0; i < 16; i += hn::Lanes(d)) {
        const VD at =
            hn::Add(hn::Set(d, middle), hn::Mul(hn::Set(d, half), hn::LoadU(d, rule.x.data() + i)));
        hn::Store(at, d, c + i);
        hn::Store(Exp(hn::Sub(ExponentAt(g, at), hn::Set(d, peak))), d, e + i);
    }
    double mass = 0.0, first = 0.0, gauss_mass = 0.0, gauss_first = 0.0;
    for (std::size_t i = 0; i < 15; ++i) {
        const double kronrod = rule.kronrod[i] * e[i], gauss = rule.gauss[i] * e[i];
        mass += kronrod;
        first += kronrod * c[i];
        gauss_mass += gauss;
        gauss_first += gauss * c[i];
    }
    sums[0] = half * mass;
    sums[1] = half * first;
    sums[2] = half * (mass - gauss_mass);
    sums[3] = half * (first - gauss_first);
}

/// Four values at a time, whatever the target: four cubics are four loads and a transposition,
/// which is faster than gathering.
void ReadTable(const CubicTable& table, const float* in, float* out, std::size_t n)
{
    const hn::FixedTag<float, 4> d;
    const hn::FixedTag<std::int32_t, 4> di;
    using V = hn::Vec<decltype(d)>;
    const int drop = 23 - table.shift;
    const auto first = hn::Set(di, (127 + table.first_exponent) << table.shift);
    const auto last = hn::Set(di, static_cast<std::int32_t>(table.cubics.size()) - 1);
    const auto place_bits = hn::Set(di, (1 << drop) - 1);
    const V inverse_scale = hn::Set(d, table.inverse_scale), scale = hn::Set(d, table.scale);
    const V slope = hn::Set(d, table.slope), end = hn::Set(d, table.end);
    const V end_loss = hn::Set(d, table.end_loss * table.scale);
    const V one = hn::Set(d, 1.0f);
    const auto read = [&](const float* from, float* to) HWY_ATTR {
        const V y = hn::LoadU(d, from);
        const V magnitude = hn::Abs(y);
        const V scaled = hn::Mul(magnitude, inverse_scale);
        const auto bits = hn::BitCast(di, scaled);
        const auto segment = hn::Sub(hn::ShiftRightSame(bits, drop), first);
        HWY_ALIGN std::int32_t at[4];
        hn::Store(hn::Min(hn::Max(segment, hn::Zero(di)), last), di, at);
        const V r0 = hn::LoadU(d, &table.cubics[static_cast<std::size_t>(at[0])].c0);
        const V r1 = hn::LoadU(d, &table.cubics[static_cast<std::size_t>(at[1])].c0);
        const V r2 = hn::LoadU(d, &table.cubics[static_cast<std::size_t>(at[2])].c0);
        const V r3 = hn::LoadU(d, &table.cubics[static_cast<std::size_t>(at[3])].c0);
        const V lower01 = hn::InterleaveLower(d, r0, r1), lower23 = hn::InterleaveLower(d, r2, r3);
        const V upper01 = hn::InterleaveUpper(d, r0, r1), upper23 = hn::InterleaveUpper(d, r2, r3);
        const V c0 = hn::ConcatLowerLower(d, lower23, lower01);
        const V c1 = hn::ConcatUpperUpper(d, lower23, lower01);
        const V c2 = hn::ConcatLowerLower(d, upper23, upper01);
        const V c3 = hn::ConcatUpperUpper(d, upper23, upper01);
        // The bits after the segment's number are the place in it.
        const auto place = hn::ShiftLeftSame(hn::And(bits, place_bits), table.shift);
        const V t = hn::Sub(hn::BitCast(d, hn::Or(place, hn::BitCast(di, one))), one);
        const V value =
            hn::Add(c0, hn::Mul(t, hn::Add(c1, hn::Mul(t, hn::Add(c2, hn::Mul(t, c3))))));
        V result = hn::Min(hn::Mul(scale, value), magnitude);
        result = hn::IfThenElse(hn::RebindMask(d, hn::Lt(segment, hn::Zero(di))),
                                hn::Mul(slope, magnitude), result);
        result = hn::IfThenElse(hn::Ge(scaled, end), hn::Sub(magnitude, end_loss), result);
        hn::StoreU(hn::CopySign(result, y), d, to);
    };
    std::size_t i = 0;
    for (; i + 4 <= n; i += 4) read(in + i, out + i);
    if (i == n) return;
    HWY_ALIGN float rest[4] = {};
    std::copy_n(in + i, n - i, rest);
    read(rest, rest);
    std::copy_n(rest, n - i, out + i);
}

} // namespace
} // namespace HWY_NAMESPACE
} // namespace rayloom
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace rayloom
{

HWY_EXPORT(Exponents);
HWY_EXPORT(IntervalSums);
HWY_EXPORT(ReadTable);

void posterior_exponents(const PosteriorExponent& exponent, std::span<const double> c,
                         std::span<double> g)
{
    HWY_DYNAMIC_DISPATCH(Exponents)(exponent, c.data(), g.data(), c.size());
}

PosteriorInterval posterior_interval(const PosteriorExponent& exponent, double peak, double lo,
                                     double hi)
{
    std::array<double, 4> sums{};
    HWY_DYNAMIC_DISPATCH(IntervalSums)
    (exponent, peak, rule(), 0.5 * (lo + hi), 0.5 * (hi - lo), sums.data());
    return {lo, hi, sums[0], sums[1], sums[2], sums[3]};
}

void read_cubic_table(const CubicTable& table, std::span<const float> in, std::span<float> out)
{
    HWY_DYNAMIC_DISPATCH(ReadTable)(table, in.data(), out.data(), in.size());
}

} // namespace rayloom
#endif

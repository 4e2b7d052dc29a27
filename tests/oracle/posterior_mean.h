// SPDX-License-Identifier: Apache-2.0
/// \file
/// The mean of a signal given what is seen of it through noise, straight from
/// 001_6a300dc64642895d.txt, equation (11), by Boost's adaptive quadrature.
#pragma once

namespace rayloom::oracle
{

/// ∫ p_n(y−c) p_c(c) c dc / ∫ p_n(y−c) p_c(c) dc for densities exp(−|x/s|^p)/Z; about 1e-9 s_n.
double posterior_mean(double y, double signal_s, double signal_p, double noise_s, double noise_p);

} // namespace rayloom::oracle

#pragma once

#include <array>
#include <span>
#include <vector>

namespace orbid::models {

/// Derivatives of the band-limited signal through equidistant samples, at the samples: {h u', h^2 u'', h^3 u'''} with
/// the step h.
///
/// The signal is the sampling series (Whittaker, Shannon), cut off by a window: u(s) = sum_k u_k w((s - k) / 32)
/// sinc(s - k), w(x) = exp(16 (sqrt(1 - x^2) - 1)) (A. Barnett, J. Magland, L. af Klinteberg, SIAM J. Sci. Comput.
/// 41:C479, 2019). Between the samples, by hermite_septic(), the worst error of a sine with r samples per period is
/// 1.4e-4 of its amplitude at r = 2.5, 3.3e-5 at 3, 3.1e-6 at 4, 2e-8 from 8 on. At both ends the samples are continued
/// by reflection in the end point; within 32 samples of an end a bent signal is followed less closely.
///
/// @param samples  at least two
[[nodiscard]] std::vector<std::array<double, 3>> band_limited_derivatives(std::span<const double> samples);

/// Coefficients of the polynomial of degree 7 in s that has these values and derivatives {h u', h^2 u'', h^3 u'''} at
/// s = 0 and s = 1 (Hermite).
[[nodiscard]] std::array<double, 8> hermite_septic(double first, const std::array<double, 3>& first_derivatives,
                                                   double last, const std::array<double, 3>& last_derivatives);

}  // namespace orbid::models

#pragma once

#include <algorithm>

namespace orbid::models {

/// Zero in (0, 1) of the cubic c with c(0) = v0, c(1) = v1, c'(0) = a0, c'(1) = a1, by four steps of Newton's method.
/// It is a guess: the caller must keep it inside a bracket.
///
/// v0 and v1 have opposite signs. @param from  where Newton's method begins: the zero of the chord unless given.
[[nodiscard]] inline double cubic_zero(double v0, double v1, double a0, double a1, double from) {
    const double c2 = 3.0 * (v1 - v0) - 2.0 * a0 - a1, c3 = 2.0 * (v0 - v1) + a0 + a1;
    double at = from;
    for (int i = 0; i < 4; ++i)
        at -= (v0 + at * (a0 + at * (c2 + at * c3))) / (a0 + at * (2.0 * c2 + 3.0 * at * c3));
    return at;
}

[[nodiscard]] inline double cubic_zero(double v0, double v1, double a0, double a1) {
    return cubic_zero(v0, v1, a0, a1, v0 / (v0 - v1));
}

/// The same for a cubic that may rise first and then falls through zero (v0 >= 0). The zero then lies nearer to the
/// end, and a start on the chord would lead Newton's method beyond the maximum.
[[nodiscard]] inline double falling_cubic_zero(double v0, double v1, double a0, double a1) {
    return cubic_zero(v0, v1, a0, a1, a0 > 0.0 ? 1.0 : v0 / (v0 - v1));
}

/// The same zero for the polynomial of degree 4 with these end values, end slopes and integral over (0, 1): what a step
/// knows about a velocity. The cubic with the end values and slopes has the integral (v0 + v1)/2 + (a0 - a1)/12; x^2 (1
/// - x)^2 has 1/30.
template <class T>
[[nodiscard]] T quartic_zero(const T& v0, const T& v1, const T& a0, const T& a1, const T& integral) {
    using std::max, std::min;
    const T bulge = 30.0 * (integral - 0.5 * (v0 + v1) - (a0 - a1) / 12.0);
    const T c2 = 3.0 * (v1 - v0) - 2.0 * a0 - a1 + bulge;
    const T c3 = 2.0 * (v0 - v1) + a0 + a1 - 2.0 * bulge;
    T at = v0 / (v0 - v1);
    // Newton's method: the error of the secant, some hundredths, is squared each time.
    for (int i = 0; i < 4; ++i)
        at = at - (v0 + at * (a0 + at * (c2 + at * (c3 + at * bulge)))) /
                      (a0 + at * (2.0 * c2 + at * (3.0 * c3 + at * 4.0 * bulge)));
    return min(max(at, T(0.0)), T(1.0));
}

}  // namespace orbid::models

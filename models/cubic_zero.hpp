#pragma once

namespace orbid::models {

/// Zero in (0, 1) of the cubic c with c(0) = v0, c(1) = v1, c'(0) = a0, c'(1) = a1, by four steps of Newton's method: a
/// guess, to be held inside a bracket by whoever uses it.
///
/// For v0 and v1 of opposite signs; @param from  where Newton's method begins: the zero of the chord unless given.
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

/// The same for a cubic that may rise first and then falls through zero (v0 >= 0): the zero is nearer to the end then,
/// and the chord would lead Newton's method beyond the maximum.
[[nodiscard]] inline double falling_cubic_zero(double v0, double v1, double a0, double a1) {
    return cubic_zero(v0, v1, a0, a1, a0 > 0.0 ? 1.0 : v0 / (v0 - v1));
}

}  // namespace orbid::models

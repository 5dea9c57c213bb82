#pragma once

#include <array>
#include <cmath>

namespace orbid::tests {

/// A number with its gradient with respect to N parameters: exact derivatives for the residuals of tests and
/// benchmarks, cheap enough to be timed (no memory outside the number, constants stay plain numbers).
template <int N>
struct SmallDual {
    double v = 0.0;
    std::array<double, N> d{};

    SmallDual() = default;
    SmallDual(double value) : v(value) {}  // NOLINT: constants mix with duals
    static SmallDual variable(double value, int index) {
        SmallDual result(value);
        result.d[static_cast<std::size_t>(index)] = 1.0;
        return result;
    }
};

inline double value_of(double a) {
    return a;
}
template <int N>
double value_of(const SmallDual<N>& a) {
    return a.v;
}

/// f(a) with slope df/da, and f(a, b) with both slopes.
template <int N>
SmallDual<N> chained(double value, double slope, const SmallDual<N>& a) {
    SmallDual<N> result(value);
    for (std::size_t i = 0; i < N; ++i)
        result.d[i] = slope * a.d[i];
    return result;
}
template <int N>
SmallDual<N> chained(double value, double slope_a, const SmallDual<N>& a, double slope_b, const SmallDual<N>& b) {
    SmallDual<N> result(value);
    for (std::size_t i = 0; i < N; ++i)
        result.d[i] = slope_a * a.d[i] + slope_b * b.d[i];
    return result;
}

template <int N>
SmallDual<N> operator-(const SmallDual<N>& a) {
    return chained(-a.v, -1.0, a);
}
template <int N>
SmallDual<N> operator+(const SmallDual<N>& a, const SmallDual<N>& b) {
    return chained(a.v + b.v, 1.0, a, 1.0, b);
}
template <int N>
SmallDual<N> operator-(const SmallDual<N>& a, const SmallDual<N>& b) {
    return chained(a.v - b.v, 1.0, a, -1.0, b);
}
template <int N>
SmallDual<N> operator*(const SmallDual<N>& a, const SmallDual<N>& b) {
    return chained(a.v * b.v, b.v, a, a.v, b);
}
template <int N>
SmallDual<N> operator/(const SmallDual<N>& a, const SmallDual<N>& b) {
    const double value = a.v / b.v;
    return chained(value, 1.0 / b.v, a, -value / b.v, b);
}
template <int N>
SmallDual<N> operator+(SmallDual<N> a, double b) {
    a.v += b;
    return a;
}
template <int N>
SmallDual<N> operator+(double a, SmallDual<N> b) {
    b.v += a;
    return b;
}
template <int N>
SmallDual<N> operator-(SmallDual<N> a, double b) {
    a.v -= b;
    return a;
}
template <int N>
SmallDual<N> operator-(double a, const SmallDual<N>& b) {
    return chained(a - b.v, -1.0, b);
}
template <int N>
SmallDual<N> operator*(const SmallDual<N>& a, double b) {
    return chained(a.v * b, b, a);
}
template <int N>
SmallDual<N> operator*(double a, const SmallDual<N>& b) {
    return b * a;
}
template <int N>
SmallDual<N> operator/(const SmallDual<N>& a, double b) {
    return chained(a.v / b, 1.0 / b, a);
}
template <int N>
SmallDual<N> operator/(double a, const SmallDual<N>& b) {
    const double value = a / b.v;
    return chained(value, -value / b.v, b);
}
template <int N>
SmallDual<N> exp(const SmallDual<N>& a) {
    const double value = std::exp(a.v);
    return chained(value, value, a);
}
template <int N>
SmallDual<N> log(const SmallDual<N>& a) {
    return chained(std::log(a.v), 1.0 / a.v, a);
}
template <int N>
SmallDual<N> sqrt(const SmallDual<N>& a) {
    const double value = std::sqrt(a.v);
    return chained(value, 0.5 / value, a);
}
template <int N>
SmallDual<N> sin(const SmallDual<N>& a) {
    return chained(std::sin(a.v), std::cos(a.v), a);
}
template <int N>
SmallDual<N> cos(const SmallDual<N>& a) {
    return chained(std::cos(a.v), -std::sin(a.v), a);
}
template <int N>
SmallDual<N> atan(const SmallDual<N>& a) {
    return chained(std::atan(a.v), 1.0 / (1.0 + a.v * a.v), a);
}
template <int N>
SmallDual<N> pow(const SmallDual<N>& a, const SmallDual<N>& b) {
    const double value = std::pow(a.v, b.v);
    // 0^b has slopes 0 for b > 1; the formula would give 0 times infinity.
    if (a.v == 0.0 && b.v > 1.0) return SmallDual<N>(value);
    return chained(value, b.v * std::pow(a.v, b.v - 1.0), a, value * std::log(a.v), b);
}
template <int N>
SmallDual<N> pow(double a, const SmallDual<N>& b) {
    const double value = std::pow(a, b.v);
    return chained(value, value * std::log(a), b);
}

}  // namespace orbid::tests

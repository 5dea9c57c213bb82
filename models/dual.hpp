#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace orbid::models {

/// Forward dual number: a value with its derivatives in N directions.
///
///     f(a + sum_i a_i e_i) = f(a) + f'(a) sum_i a_i e_i,   e_i e_j = 0
///
/// The value is computed by exactly the operations that plain double would use, so programs that branch on values only
/// give bit-identical values in both. Comparisons look at the value. Trivially copyable: N + 1 doubles, value first.
template <std::size_t N>
struct Dual {
    double value;
    std::array<double, N> partial;

    Dual() = default;
    /// A constant.
    constexpr Dual(double constant) : value(constant), partial{} {}  // NOLINT: implicit, a constant is a number
    constexpr Dual(double value_, const std::array<double, N>& partial_) : value(value_), partial(partial_) {}

    /// value with derivative 1 in one direction.
    [[nodiscard]] static constexpr Dual variable(double value, std::size_t direction) {
        Dual x(value);
        x.partial[direction] = 1.0;
        return x;
    }

    Dual& operator+=(const Dual& b) { return *this = *this + b; }
    Dual& operator-=(const Dual& b) { return *this = *this - b; }
    Dual& operator*=(const Dual& b) { return *this = *this * b; }
    Dual& operator/=(const Dual& b) { return *this = *this / b; }

    friend Dual operator+(const Dual& a) { return a; }
    friend Dual operator-(const Dual& a) {
        Dual r;
        r.value = -a.value;
        for (std::size_t i = 0; i < N; ++i)
            r.partial[i] = -a.partial[i];
        return r;
    }
    friend Dual operator+(const Dual& a, const Dual& b) {
        Dual r;
        r.value = a.value + b.value;
        for (std::size_t i = 0; i < N; ++i)
            r.partial[i] = a.partial[i] + b.partial[i];
        return r;
    }
    friend Dual operator-(const Dual& a, const Dual& b) {
        Dual r;
        r.value = a.value - b.value;
        for (std::size_t i = 0; i < N; ++i)
            r.partial[i] = a.partial[i] - b.partial[i];
        return r;
    }
    friend Dual operator*(const Dual& a, const Dual& b) {
        Dual r;
        r.value = a.value * b.value;
        for (std::size_t i = 0; i < N; ++i)
            r.partial[i] = a.value * b.partial[i] + b.value * a.partial[i];
        return r;
    }
    friend Dual operator/(const Dual& a, const Dual& b) {
        Dual r;
        r.value = a.value / b.value;
        // One division for all directions; the value keeps its own, correctly rounded one.
        const double inverse = 1.0 / b.value;
        for (std::size_t i = 0; i < N; ++i)
            r.partial[i] = (a.partial[i] - r.value * b.partial[i]) * inverse;
        return r;
    }

    friend Dual operator+(const Dual& a, double b) { return {a.value + b, a.partial}; }
    friend Dual operator+(double a, const Dual& b) { return {a + b.value, b.partial}; }
    friend Dual operator-(const Dual& a, double b) { return {a.value - b, a.partial}; }
    friend Dual operator-(double a, const Dual& b) { return (-b).shifted_to(a - b.value); }
    friend Dual operator*(const Dual& a, double b) { return a.chained(a.value * b, b); }
    friend Dual operator*(double a, const Dual& b) { return b.chained(a * b.value, a); }
    friend Dual operator/(const Dual& a, double b) { return a.chained(a.value / b, 1.0 / b); }
    friend Dual operator/(double a, const Dual& b) {
        const double quotient = a / b.value;
        return b.chained(quotient, -quotient / b.value);
    }

    friend bool operator<(const Dual& a, const Dual& b) { return a.value < b.value; }
    friend bool operator>(const Dual& a, const Dual& b) { return a.value > b.value; }
    friend bool operator<=(const Dual& a, const Dual& b) { return a.value <= b.value; }
    friend bool operator>=(const Dual& a, const Dual& b) { return a.value >= b.value; }
    friend bool operator==(const Dual& a, const Dual& b) { return a.value == b.value; }
    friend bool operator!=(const Dual& a, const Dual& b) { return a.value != b.value; }

    /// Chain rule: the dual with this function value and this derivative times our partials.
    [[nodiscard]] Dual chained(double function, double derivative) const {
        Dual r;
        r.value = function;
        for (std::size_t i = 0; i < N; ++i)
            r.partial[i] = derivative * partial[i];
        return r;
    }

    friend Dual sin(const Dual& a) { return a.chained(std::sin(a.value), std::cos(a.value)); }
    friend Dual cos(const Dual& a) { return a.chained(std::cos(a.value), -std::sin(a.value)); }
    friend Dual tan(const Dual& a) {
        const double t = std::tan(a.value);
        return a.chained(t, 1.0 + t * t);
    }
    friend Dual asin(const Dual& a) {
        return a.chained(std::asin(a.value), 1.0 / std::sqrt((1.0 - a.value) * (1.0 + a.value)));
    }
    friend Dual acos(const Dual& a) {
        return a.chained(std::acos(a.value), -1.0 / std::sqrt((1.0 - a.value) * (1.0 + a.value)));
    }
    friend Dual atan(const Dual& a) { return a.chained(std::atan(a.value), 1.0 / (1.0 + a.value * a.value)); }
    friend Dual atan2(const Dual& y, const Dual& x) {
        Dual r;
        r.value = std::atan2(y.value, x.value);
        const double inverse = 1.0 / (x.value * x.value + y.value * y.value);
        for (std::size_t i = 0; i < N; ++i)
            r.partial[i] = (x.value * y.partial[i] - y.value * x.partial[i]) * inverse;
        return r;
    }
    friend Dual sinh(const Dual& a) { return a.chained(std::sinh(a.value), std::cosh(a.value)); }
    friend Dual cosh(const Dual& a) { return a.chained(std::cosh(a.value), std::sinh(a.value)); }
    friend Dual tanh(const Dual& a) {
        const double t = std::tanh(a.value);
        return a.chained(t, (1.0 - t) * (1.0 + t));
    }
    friend Dual exp(const Dual& a) {
        const double e = std::exp(a.value);
        return a.chained(e, e);
    }
    friend Dual log(const Dual& a) { return a.chained(std::log(a.value), 1.0 / a.value); }
    friend Dual sqrt(const Dual& a) {
        const double root = std::sqrt(a.value);
        return a.chained(root, 0.5 / root);
    }
    /// At 0 the derivative is that of the right side, as for a frozen positive sign.
    friend Dual abs(const Dual& a) { return a.value < 0.0 ? -a : a; }
    friend Dual pow(const Dual& a, double exponent) {
        // exponent 0 must not turn 0 * pow(0, -1) into nan.
        if (exponent == 0.0) return Dual(1.0);
        return a.chained(std::pow(a.value, exponent), exponent * std::pow(a.value, exponent - 1.0));
    }
    friend Dual pow(const Dual& a, const Dual& b) {
        const double power = std::pow(a.value, b.value);
        const double by_base = b.value == 0.0 ? 0.0 : b.value * std::pow(a.value, b.value - 1.0);
        // d/db a^b = a^b ln a; at a = 0 its limit is 0.
        const double by_exponent = a.value == 0.0 ? 0.0 : power * std::log(a.value);
        Dual r;
        r.value = power;
        for (std::size_t i = 0; i < N; ++i) {
            // A constant exponent has no share in the derivative, even where ln a is undefined (a < 0).
            const double share = b.partial[i] == 0.0 ? 0.0 : by_exponent * b.partial[i];
            r.partial[i] = by_base * a.partial[i] + share;
        }
        return r;
    }

private:
    [[nodiscard]] Dual shifted_to(double new_value) const { return {new_value, partial}; }
};

/// The value without its derivatives; plain numbers are their own value.
constexpr double value_of(double x) {
    return x;
}
template <std::size_t N>
constexpr double value_of(const Dual<N>& x) {
    return x.value;
}

/// double for 0 directions, Dual<N> otherwise.
namespace detail {
template <std::size_t N>
struct ScalarOf {
    using type = Dual<N>;
};
template <>
struct ScalarOf<0> {
    using type = double;
};
}  // namespace detail
template <std::size_t N>
using Scalar = typename detail::ScalarOf<N>::type;

}  // namespace orbid::models

#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <numeric>
#include <type_traits>
#include <utility>

#include "models/arithmetic/sine_and_cosine.hpp"
#include "models/arithmetic/vector_register.hpp"

namespace orbid::models {

/// a b + c, rounded once where the machine does so at no cost. Explicit, so that values are the same with and without
/// derivatives.
[[gnu::always_inline]] inline double multiply_add(double a, double b, double c) {
#if defined(__FMA__) || defined(FP_FAST_FMA)
    return std::fma(a, b, c);
#else
    return a * b + c;
#endif
}

/// The value without its derivatives; plain numbers are their own value.
constexpr double value_of(double x) {
    return x;
}

/// True when it depends on nothing: 0, with derivatives 0.
constexpr bool vanishes(double x) {
    return x == 0.0;
}

namespace detail {

/// result[i] = f(a[i]...). Doubles are read and written by registers as wide as N allows: the compiler then keeps
/// partials in registers from one operation to the next. Loops over doubles it leaves in memory, where what is written
/// in parts and read whole stalls the processor.
template <class B, std::size_t N, class F, class... A>
[[gnu::always_inline]] inline void each(const F& f, std::array<B, N>& result, const A&... a) {
    if constexpr (std::is_same_v<B, double>) {
        constexpr std::size_t width = std::gcd(N, register_width);
        using Register = VectorRegister<width>;
        for (std::size_t i = 0; i < N; i += width) {
            const Register r = f(load_register<Register>(&a[i])...);
            std::memcpy(&result[i], &r, sizeof r);
        }
    } else {
        for (std::size_t i = 0; i < N; ++i)
            result[i] = f(a[i]...);
    }
}

}  // namespace detail

/// Forward dual number: a value with its derivatives in N directions.
///
///     f(a + sum_i a_i e_i) = f(a) + f'(a) sum_i a_i e_i,   e_i e_j = 0
///
/// The value is computed by exactly the operations that plain B would use, but for sines and cosines, which come
/// together and to one ulp. Comparisons look at the value. Trivially copyable: value first, then N partials. Arithmetic
/// is inlined by force: compilers give up on long right hand sides, and calls cost more than the sums. B = double, or a
/// dual number itself for second derivatives. In Dual<1, Dual<N>> the partial holds the derivative in one direction and
/// its derivatives in N.
template <std::size_t N, class B = double>
struct Dual {
    B value;
    std::array<B, N> partial;

    Dual() = default;
    /// A constant.
    constexpr Dual(double constant) : value(constant), partial{} {}  // NOLINT: implicit, a constant is a number
    constexpr Dual(const B& value_, const std::array<B, N>& partial_) : value(value_), partial(partial_) {}

    /// value with derivative 1 in one direction.
    [[nodiscard]] static constexpr Dual variable(double value, std::size_t direction) {
        Dual x(value);
        x.partial[direction] = B(1.0);
        return x;
    }

    Dual& operator+=(const Dual& b) { return *this = *this + b; }
    Dual& operator-=(const Dual& b) { return *this = *this - b; }
    Dual& operator*=(const Dual& b) { return *this = *this * b; }
    Dual& operator/=(const Dual& b) { return *this = *this / b; }

    friend Dual operator+(const Dual& a) { return a; }
    [[gnu::always_inline]] friend Dual operator-(const Dual& a) {
        Dual r;
        r.value = -a.value;
        detail::each([&](const auto& da) { return -da; }, r.partial, a.partial);
        return r;
    }
    [[gnu::always_inline]] friend Dual operator+(const Dual& a, const Dual& b) {
        Dual r;
        r.value = a.value + b.value;
        detail::each([&](const auto& da, const auto& db) { return da + db; }, r.partial, a.partial, b.partial);
        return r;
    }
    [[gnu::always_inline]] friend Dual operator-(const Dual& a, const Dual& b) {
        Dual r;
        r.value = a.value - b.value;
        detail::each([&](const auto& da, const auto& db) { return da - db; }, r.partial, a.partial, b.partial);
        return r;
    }
    [[gnu::always_inline]] friend Dual operator*(const Dual& a, const Dual& b) {
        Dual r;
        r.value = a.value * b.value;
        detail::each([&](const auto& db, const auto& da) { return multiply_add(a.value, db, b.value * da); }, r.partial,
                     b.partial, a.partial);
        return r;
    }
    [[gnu::always_inline]] friend Dual operator/(const Dual& a, const Dual& b) {
        Dual r;
        r.value = a.value / b.value;
        // One division for all directions; the value keeps its own, correctly rounded one.
        const B inverse = 1.0 / b.value;
        const B slope = -r.value * inverse;
        detail::each([&](const auto& da, const auto& db) { return multiply_add(inverse, da, slope * db); }, r.partial,
                     a.partial, b.partial);
        return r;
    }

    [[gnu::always_inline]] friend Dual operator+(const Dual& a, double b) { return {a.value + b, a.partial}; }
    friend Dual operator+(double a, const Dual& b) { return {a + b.value, b.partial}; }
    friend Dual operator-(const Dual& a, double b) { return {a.value - b, a.partial}; }
    [[gnu::always_inline]] friend Dual operator-(double a, const Dual& b) {
        Dual r;
        r.value = a - b.value;
        detail::each([&](const auto& db) { return -db; }, r.partial, b.partial);
        return r;
    }
    friend Dual operator*(const Dual& a, double b) { return a.chained(a.value * b, b); }
    friend Dual operator*(double a, const Dual& b) { return b.chained(a * b.value, a); }
    friend Dual operator/(const Dual& a, double b) { return a.chained(a.value / b, 1.0 / b); }
    friend Dual operator/(double a, const Dual& b) {
        const B quotient = a / b.value;
        return b.chained(quotient, -quotient / b.value);
    }
    /// a b + c of values and partials.
    [[gnu::always_inline]] friend Dual multiply_add(double a, const Dual& b, const Dual& c) {
        Dual r;
        r.value = multiply_add(a, b.value, c.value);
        detail::each([&](const auto& db, const auto& dc) { return multiply_add(a, db, dc); }, r.partial, b.partial,
                     c.partial);
        return r;
    }
    [[gnu::always_inline]] friend Dual multiply_add(const Dual& a, const Dual& b, const Dual& c) {
        Dual r;
        r.value = multiply_add(a.value, b.value, c.value);
        detail::each([&](const auto& db, const auto& da,
                         const auto& dc) { return multiply_add(a.value, db, multiply_add(b.value, da, dc)); },
                     r.partial, b.partial, a.partial, c.partial);
        return r;
    }

    friend bool operator<(const Dual& a, const Dual& b) { return a.value < b.value; }
    friend bool operator>(const Dual& a, const Dual& b) { return a.value > b.value; }
    friend bool operator<=(const Dual& a, const Dual& b) { return a.value <= b.value; }
    friend bool operator>=(const Dual& a, const Dual& b) { return a.value >= b.value; }
    friend bool operator==(const Dual& a, const Dual& b) { return a.value == b.value; }
    friend bool operator!=(const Dual& a, const Dual& b) { return a.value != b.value; }
    friend constexpr double value_of(const Dual& x) { return value_of(x.value); }
    friend constexpr bool vanishes(const Dual& x) {
        bool all = vanishes(x.value);
        for (std::size_t i = 0; i < N; ++i)
            all = all && vanishes(x.partial[i]);
        return all;
    }

    /// Chain rule: the dual with this function value and this derivative, a B or a plain number, times our partials.
    template <class F>
    [[nodiscard]] [[gnu::always_inline]] Dual chained(const B& function, const F& derivative) const {
        Dual r;
        r.value = function;
        detail::each([&](const auto& d) { return derivative * d; }, r.partial, partial);
        return r;
    }

    [[gnu::always_inline]] friend Dual sin(const Dual& a) {
        const auto [s, c] = sine_and_cosine(a.value);
        return a.chained(s, c);
    }
    [[gnu::always_inline]] friend Dual cos(const Dual& a) {
        const auto [s, c] = sine_and_cosine(a.value);
        return a.chained(c, -s);
    }
    friend auto sine_and_cosine(const Dual& a) {
        const auto [s, c] = sine_and_cosine(a.value);
        return std::pair(a.chained(s, c), a.chained(c, -s));
    }
    friend Dual tan(const Dual& a) {
        using std::tan;
        const B t = tan(a.value);
        return a.chained(t, 1.0 + t * t);
    }
    friend Dual asin(const Dual& a) {
        using std::asin, std::sqrt;
        return a.chained(asin(a.value), 1.0 / sqrt((1.0 - a.value) * (1.0 + a.value)));
    }
    friend Dual acos(const Dual& a) {
        using std::acos, std::sqrt;
        return a.chained(acos(a.value), -1.0 / sqrt((1.0 - a.value) * (1.0 + a.value)));
    }
    friend Dual atan(const Dual& a) {
        using std::atan;
        return a.chained(atan(a.value), 1.0 / (1.0 + a.value * a.value));
    }
    friend Dual atan2(const Dual& y, const Dual& x) {
        using std::atan2;
        Dual r;
        r.value = atan2(y.value, x.value);
        const B inverse = 1.0 / (x.value * x.value + y.value * y.value);
        detail::each([&](const auto& dy, const auto& dx) { return (x.value * dy - y.value * dx) * inverse; }, r.partial,
                     y.partial, x.partial);
        return r;
    }
    friend Dual sinh(const Dual& a) {
        using std::cosh, std::sinh;
        return a.chained(sinh(a.value), cosh(a.value));
    }
    friend Dual cosh(const Dual& a) {
        using std::cosh, std::sinh;
        return a.chained(cosh(a.value), sinh(a.value));
    }
    friend Dual tanh(const Dual& a) {
        using std::tanh;
        const B t = tanh(a.value);
        return a.chained(t, (1.0 - t) * (1.0 + t));
    }
    friend Dual exp(const Dual& a) {
        using std::exp;
        const B e = exp(a.value);
        return a.chained(e, e);
    }
    friend Dual log(const Dual& a) {
        using std::log;
        return a.chained(log(a.value), 1.0 / a.value);
    }
    friend Dual sqrt(const Dual& a) {
        using std::sqrt;
        const B root = sqrt(a.value);
        return a.chained(root, 0.5 / root);
    }
    /// At 0 the derivative is that of the right side, as for a frozen positive sign.
    friend Dual abs(const Dual& a) { return a.value < 0.0 ? -a : a; }
    friend Dual pow(const Dual& a, double exponent) {
        using std::pow;
        // exponent 0 must not turn 0 * pow(0, -1) into nan.
        if (exponent == 0.0) return Dual(1.0);
        return a.chained(pow(a.value, exponent), exponent * pow(a.value, exponent - 1.0));
    }
    friend Dual pow(const Dual& a, const Dual& b) {
        using std::log, std::pow;
        const B power = pow(a.value, b.value);
        const B by_base = vanishes(b.value) ? B(0.0) : b.value * pow(a.value, b.value - 1.0);
        // d/db a^b = a^b ln a; at a = 0 its limit is 0.
        const B by_exponent = a.value == 0.0 ? B(0.0) : power * log(a.value);
        Dual r;
        r.value = power;
        for (std::size_t i = 0; i < N; ++i) {
            // A constant exponent contributes nothing to the derivative, even where ln a is undefined (a < 0).
            const B share = vanishes(b.partial[i]) ? B(0.0) : by_exponent * b.partial[i];
            r.partial[i] = by_base * a.partial[i] + share;
        }
        return r;
    }
};

namespace detail {
template <std::size_t N, std::size_t order>
struct ScalarOf {
    static_assert(order == 2);
    using type = Dual<1, Dual<N>>;
};
template <std::size_t N>
struct ScalarOf<N, 1> {
    using type = Dual<N>;
};
template <>
struct ScalarOf<0, 1> {
    using type = double;
};
}  // namespace detail

/// double for 0 directions, Dual<N> otherwise. Order 2 adds the derivative in one more direction, with its own
/// derivatives in the N. The nesting is Dual<1, Dual<N>> because loops over the N suit vector instructions.
template <std::size_t N, std::size_t order = 1>
using Scalar = typename detail::ScalarOf<N, order>::type;

/// The part without the second derivatives.
template <class D>
auto& first_order(D& x) {
    if constexpr (requires { x.value.partial; })
        return x.value;
    else
        return x;
}

}  // namespace orbid::models

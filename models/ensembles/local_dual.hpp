#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "models/arithmetic/pack.hpp"
#include "models/definition/model.hpp"

namespace orbid::models {

/// A number P with its partials by those of L local variables on which it depends.
///
/// Right hand sides depend on few variables at a time: most partials are known to be zero at compile time. A bit mask
/// tells the others. The compiler resolves it once all is inlined and all loops are unrolled, so nothing is computed or
/// stored for zeros. One evaluation with derivatives takes 0.4 of the time of dual numbers that carry every direction
/// of a flow. Measured per pack: parametric pendulum with four parameters 63 against 25 ns, double pendulum with four
/// 208 against 77, Lorenz with three 52 against 20.
///
/// As with Pack, comparisons give no truth value: a model that branches on its numbers says `packs = false`.
template <std::size_t L, class P>
class LocalDual {
    static_assert(L <= 64);

public:
    P value;

    LocalDual() = default;
    [[gnu::always_inline]] LocalDual(double constant) : value(constant), depends_(0) {}    // NOLINT: implicit
    [[gnu::always_inline]] LocalDual(const P& constant) : value(constant), depends_(0) {}  // NOLINT: implicit
    /// Local variable i itself.
    [[nodiscard, gnu::always_inline]] static LocalDual variable(const P& value, std::size_t i) {
        LocalDual x(value);
        x.partial_[i] = P(1.0);
        x.depends_ = std::uint64_t{1} << i;
        return x;
    }
    [[nodiscard, gnu::always_inline]] bool depends_on(std::size_t i) const { return (depends_ >> i & 1u) != 0; }
    /// A factor without derivatives.
    [[gnu::always_inline]] friend const P& value_of(const LocalDual& x) { return x.value; }
    /// Defined where it depends on variable i.
    [[nodiscard, gnu::always_inline]] const P& partial(std::size_t i) const { return partial_[i]; }

    LocalDual& operator+=(const LocalDual& b) { return *this = *this + b; }
    LocalDual& operator-=(const LocalDual& b) { return *this = *this - b; }
    LocalDual& operator*=(const LocalDual& b) { return *this = *this * b; }
    LocalDual& operator/=(const LocalDual& b) { return *this = *this / b; }

    [[gnu::always_inline]] friend LocalDual operator+(const LocalDual& a) { return a; }
    [[gnu::always_inline]] friend LocalDual operator-(const LocalDual& a) { return a.chained(-a.value, P(-1.0)); }
    [[gnu::always_inline]] friend LocalDual operator+(const LocalDual& a, const LocalDual& b) {
        return combined(
            a.value + b.value, a, b, [](const P& da, const P& db) { return da + db; }, [](const P& da) { return da; },
            [](const P& db) { return db; });
    }
    [[gnu::always_inline]] friend LocalDual operator-(const LocalDual& a, const LocalDual& b) {
        return combined(
            a.value - b.value, a, b, [](const P& da, const P& db) { return da - db; }, [](const P& da) { return da; },
            [](const P& db) { return -db; });
    }
    [[gnu::always_inline]] friend LocalDual operator*(const LocalDual& a, const LocalDual& b) {
        return linear(a.value * b.value, a, b.value, b, a.value);
    }
    [[gnu::always_inline]] friend LocalDual operator/(const LocalDual& a, const LocalDual& b) {
        const P quotient = a.value / b.value, inverse = P(1.0) / b.value;
        return linear(quotient, a, inverse, b, -quotient * inverse);
    }
    // Factors without derivatives, such as the side of a switching surface.
    [[gnu::always_inline]] friend LocalDual operator*(const P& a, const LocalDual& b) {
        return b.chained(a * b.value, a);
    }
    [[gnu::always_inline]] friend LocalDual operator*(const LocalDual& a, const P& b) { return b * a; }
    [[gnu::always_inline]] friend LocalDual operator*(double a, const LocalDual& b) { return P(a) * b; }
    [[gnu::always_inline]] friend LocalDual operator*(const LocalDual& a, double b) { return P(b) * a; }

    friend bool operator<(const LocalDual& a, const LocalDual& b) { return bool(a.value < b.value); }
    friend bool operator>(const LocalDual& a, const LocalDual& b) { return bool(a.value > b.value); }
    friend bool operator<=(const LocalDual& a, const LocalDual& b) { return bool(a.value <= b.value); }
    friend bool operator>=(const LocalDual& a, const LocalDual& b) { return bool(a.value >= b.value); }
    friend bool operator==(const LocalDual& a, const LocalDual& b) { return bool(a.value == b.value); }
    friend bool operator!=(const LocalDual& a, const LocalDual& b) { return bool(a.value != b.value); }

    [[gnu::always_inline]] friend LocalDual sin(const LocalDual& a) { return a.chained(sin(a.value), cos(a.value)); }
    [[gnu::always_inline]] friend LocalDual cos(const LocalDual& a) { return a.chained(cos(a.value), -sin(a.value)); }
    [[gnu::always_inline]] friend LocalDual tan(const LocalDual& a) {
        const P t = tan(a.value);
        return a.chained(t, 1.0 + t * t);
    }
    [[gnu::always_inline]] friend LocalDual asin(const LocalDual& a) {
        return a.chained(asin(a.value), 1.0 / sqrt((1.0 - a.value) * (1.0 + a.value)));
    }
    [[gnu::always_inline]] friend LocalDual acos(const LocalDual& a) {
        return a.chained(acos(a.value), -1.0 / sqrt((1.0 - a.value) * (1.0 + a.value)));
    }
    [[gnu::always_inline]] friend LocalDual atan(const LocalDual& a) {
        return a.chained(atan(a.value), 1.0 / (1.0 + a.value * a.value));
    }
    [[gnu::always_inline]] friend LocalDual atan2(const LocalDual& y, const LocalDual& x) {
        const P inverse = 1.0 / (x.value * x.value + y.value * y.value);
        return linear(atan2(y.value, x.value), y, x.value * inverse, x, -y.value * inverse);
    }
    [[gnu::always_inline]] friend LocalDual sinh(const LocalDual& a) { return a.chained(sinh(a.value), cosh(a.value)); }
    [[gnu::always_inline]] friend LocalDual cosh(const LocalDual& a) { return a.chained(cosh(a.value), sinh(a.value)); }
    [[gnu::always_inline]] friend LocalDual tanh(const LocalDual& a) {
        const P t = tanh(a.value);
        return a.chained(t, (1.0 - t) * (1.0 + t));
    }
    [[gnu::always_inline]] friend LocalDual exp(const LocalDual& a) {
        const P e = exp(a.value);
        return a.chained(e, e);
    }
    [[gnu::always_inline]] friend LocalDual log(const LocalDual& a) { return a.chained(log(a.value), 1.0 / a.value); }
    [[gnu::always_inline]] friend LocalDual sqrt(const LocalDual& a) {
        const P root = sqrt(a.value);
        return a.chained(root, 0.5 / root);
    }
    /// At 0 the derivative is that of the right side, as for a frozen positive sign.
    [[gnu::always_inline]] friend LocalDual abs(const LocalDual& a) {
        return a.chained(abs(a.value), select(a.value < P(0.0), P(-1.0), P(1.0)));
    }
    [[gnu::always_inline]] friend LocalDual pow(const LocalDual& a, double exponent) {
        // exponent 0 must not turn 0 * pow(0, -1) into nan.
        if (exponent == 0.0) return LocalDual(1.0);
        return a.chained(pow(a.value, P(exponent)), exponent * pow(a.value, P(exponent - 1.0)));
    }
    [[gnu::always_inline]] friend LocalDual pow(const LocalDual& a, const LocalDual& b) {
        const P power = pow(a.value, b.value), zero(0.0);
        const P by_base = select(b.value == zero, zero, b.value * pow(a.value, b.value - 1.0));
        // d/db a^b = a^b ln a; at a = 0 its limit is 0. It is also evaluated for a constant exponent, where a may be <
        // 0: a constant has no partial that nan could spoil.
        return linear(power, a, by_base, b, select(a.value == zero, zero, power * log(a.value)));
    }

private:
    template <class F>
    [[gnu::always_inline]] static void for_each_variable(const F& f) {
        [&]<std::size_t... i>(std::index_sequence<i...>) __attribute__((always_inline)) {
            (f(std::integral_constant<std::size_t, i>{}), ...);
        }
        (std::make_index_sequence<L>{});
    }
    /// A function of a alone.
    [[nodiscard, gnu::always_inline]] LocalDual chained(const P& function, const P& derivative) const {
        LocalDual r(function);
        r.depends_ = depends_;
        for_each_variable([&](auto i) __attribute__((always_inline)) {
            if (depends_on(i)) r.partial_[i] = derivative * partial_[i];
        });
        return r;
    }
    template <class Both, class A, class B>
    [[gnu::always_inline]] static LocalDual combined(const P& function, const LocalDual& a, const LocalDual& b,
                                                     const Both& both, const A& only_a, const B& only_b) {
        LocalDual r(function);
        r.depends_ = a.depends_ | b.depends_;
        for_each_variable([&](auto i) __attribute__((always_inline)) {
            if (a.depends_on(i) && b.depends_on(i))
                r.partial_[i] = both(a.partial_[i], b.partial_[i]);
            else if (a.depends_on(i))
                r.partial_[i] = only_a(a.partial_[i]);
            else if (b.depends_on(i))
                r.partial_[i] = only_b(b.partial_[i]);
        });
        return r;
    }
    [[gnu::always_inline]] static LocalDual linear(const P& function, const LocalDual& a, const P& by_a,
                                                   const LocalDual& b, const P& by_b) {
        return combined(
            function, a, b, [&](const P& da, const P& db) { return fma(by_a, da, by_b * db); },
            [&](const P& da) { return by_a * da; }, [&](const P& db) { return by_b * db; });
    }

    P partial_[L];
    std::uint64_t depends_;  ///< bit i: on variable i; the other partials are zero and not stored
};

namespace detail {
/// rhs takes dual numbers over packs, with a side for each lane where there is one.
template <class M, class P>
concept PackDualRhs = (SwitchingModel<M> && RhsTaking<M, LocalDual<2, P>, P>) ||
                      (!SwitchingModel<M> && RhsTaking<M, LocalDual<2, P>>);
}  // namespace detail

/// The phase enters f only through one number, in dual arithmetic over packs: see TabulatedModel.
template <class M, class P = Pack<1>>
concept TabulatedFlowModel = ForcedModel<M> &&
    requires(const M& model, const LocalDual<2, P>& phase, const State<LocalDual<2, P>, dimension_of<M>>& x,
             const Constants<M, LocalDual<2, P>>& c, const P& side) {
    { model.forcing(phase, c) } -> std::same_as<LocalDual<2, P>>;
    { model.rhs_forced(phase, x, c, side) } -> std::same_as<State<LocalDual<2, P>, dimension_of<M>>>;
};

/// Flows with derivatives can be computed in packs. Conditions: smooth, or with a velocity that switches; explicit
/// steps; no measured inputs; coordinates, constants and forcing are 64 numbers at most. A model whose equations branch
/// on their scalar says `packs = false`.
template <class M>
concept FlowPackModel = Model<M> && !MapModel<M> && !SurfaceTable<M> && !StiffModel<M> && !InputTable<M> &&
                        dimension_of<M> + std::tuple_size_v<Constants<M, double>> < 64 &&
                        (detail::PackDualRhs<M, Pack<1>> || TabulatedFlowModel<M>)&&!requires {
    requires !M::packs;
};

}  // namespace orbid::models

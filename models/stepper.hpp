#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <numbers>

#include <boost/numeric/odeint/algebra/array_algebra.hpp>
#include <boost/numeric/odeint/stepper/runge_kutta_fehlberg78.hpp>

#include "models/input_signal.hpp"
#include "models/model.hpp"
#include "models/simulation.hpp"

namespace orbid::models {

/// dx/ds of a model along the variable s in which a flow is measured: s = 0 at the start,
///
///     Clock::phase   tau = phase + s,         dx/ds = f / omega
///     Clock::time    tau = phase + omega s,   dx/ds = f
///
/// N directions of derivative (0: values only). The side of the switching surface is frozen during a step.
template <Model M, std::size_t N>
struct Field {
    using T = Scalar<N>;
    static constexpr std::size_t n = dimension_of<M>;

    Constants<M, T> constants;
    T omega;  ///< 0 for an autonomous model
    double phase;
    Clock clock;
    Side<M> side{};
    const InputSignal* input = nullptr;  ///< of an InputModel; `phase` is then the time at s = 0
    std::size_t piece = 0;               ///< of the input on which the present step lies

    Field(const Values<T, parameter_count_of<M>>& p, double phase_, Clock clock_)
        : constants(constants_from<M, T>(p)), omega(0.0), phase(phase_), clock(clock_) {
        if constexpr (ForcedModel<M>) omega = p[M::forcing_frequency];
        if constexpr (SwitchingModel<M>) side = 1.0;
    }

    [[nodiscard]] State<T, n> operator()(const State<T, n>& x, double s, const Side<M>& on_side) const {
        if constexpr (ForcedModel<M>) {
            if (clock == Clock::phase) {
                State<T, n> f = rhs_of<M, T>(T(phase + s), x, constants, on_side);
                for (T& component : f)
                    component = component / omega;
                return f;
            }
            return rhs_of<M, T>(omega * s + phase, x, constants, on_side);
        } else if constexpr (InputModel<M>) {
            std::array<double, input_count_of<M>> values;
            input->evaluate(piece, phase + s, values.data());
            std::array<T, input_count_of<M>> u;
            for (std::size_t i = 0; i < u.size(); ++i)
                u[i] = T(values[i]);
            return rhs_of<M, T>(T(phase + s), x, constants, on_side, u);
        } else {
            return rhs_of<M, T>(T(s), x, constants, on_side);
        }
    }
    [[nodiscard]] State<T, n> operator()(const State<T, n>& x, double s) const { return (*this)(x, s, side); }
};

/// One step of the Runge-Kutta-Fehlberg 7(8) method of Boost.Odeint, on values with N directions of derivative.
///
/// The method is linear in the stages, with real coefficients, so values and partials are stepped as one flat array of
/// doubles: the value part goes through the same operations whatever N is.
template <Model M, std::size_t N>
class Stepper {
public:
    using T = Scalar<N>;
    static constexpr std::size_t n = dimension_of<M>;
    using Point = State<T, n>;

    /// @param error  estimated local error, of the derivatives too
    void step(const Field<M, N>& field, const Point& x, const Point& slope, double s, double ds, Point& end,
              Point& error) {
        const auto system = [&field](const Flat& state, Flat& derivative, double at) {
            derivative = flat(field(point(state), at));
        };
        Flat flat_end, flat_error;
        method_.do_step(system, flat(x), flat(slope), s, flat_end, ds, flat_error);
        end = point(flat_end);
        error = point(flat_error);
    }

private:
    using Flat = std::array<double, n*(N + 1)>;
    static_assert(sizeof(Flat) == sizeof(Point));

    static Flat flat(const Point& x) {
        Flat f;
        std::memcpy(f.data(), x.data(), sizeof(f));
        return f;
    }
    static Point point(const Flat& f) {
        Point x;
        std::memcpy(static_cast<void*>(x.data()), f.data(), sizeof(f));
        return x;
    }

    boost::numeric::odeint::runge_kutta_fehlberg78<Flat, double, Flat, double, boost::numeric::odeint::array_algebra>
        method_;
};

/// Largest ratio of estimated to allowed local error.
///
/// Values: allowed = absolute + relative |x|. An angle counts with at most pi: turning around many times must not
/// loosen the tolerance. Derivatives with respect to the start (the first n directions, when any are carried): allowed
/// = 10 relative (largest entry of their column, at least 1). Near an equilibrium, and on an orbit such as phi = 0, the
/// values alone would allow any step: with them the multipliers of the hanging pendulum were wrong in the third digit.
template <Model M, std::size_t N>
double error_ratio(const State<Scalar<N>, dimension_of<M>>& error, const State<Scalar<N>, dimension_of<M>>& start,
                   const State<Scalar<N>, dimension_of<M>>& end, const FlowOptions& options) {
    constexpr std::size_t n = dimension_of<M>;
    double worst = 0.0;
    const auto judge = [&worst](double size, double allowed) {
        const double ratio = std::abs(size) / allowed;
        // nan must come out as a failed step: max(worst, nan) would drop it.
        if (!(ratio <= worst)) worst = std::isnan(ratio) ? std::numeric_limits<double>::infinity() : ratio;
    };
    for (std::size_t i = 0; i < n; ++i) {
        double size = std::max(std::abs(value_of(start[i])), std::abs(value_of(end[i])));
        if (M::coordinates[i].angle) size = std::min(size, std::numbers::pi);
        judge(value_of(error[i]), options.absolute_tolerance + options.relative_tolerance * size);
    }
    if constexpr (N >= n) {
        for (std::size_t j = 0; j < n; ++j) {
            double size = 1.0;
            for (std::size_t i = 0; i < n; ++i)
                size = std::max(size, std::abs(end[i].partial[j]));
            for (std::size_t i = 0; i < n; ++i)
                judge(error[i].partial[j], 10.0 * options.relative_tolerance * size);
        }
    }
    return worst;
}

template <std::size_t N, std::size_t n>
State<double, n> values_of(const State<Scalar<N>, n>& x) {
    State<double, n> v;
    for (std::size_t i = 0; i < n; ++i)
        v[i] = value_of(x[i]);
    return v;
}

}  // namespace orbid::models

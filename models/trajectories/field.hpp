#pragma once

#include <array>
#include <cstddef>
#include <type_traits>

#include "models/definition/input_signal.hpp"
#include "models/definition/model.hpp"
#include "models/definition/simulation.hpp"

namespace orbid::models {

/// dx/ds of a model along the variable s in which a flow is measured: s = 0 at the start,
///
///     Clock::phase   tau = phase + s,         dx/ds = f / omega
///     Clock::time    tau = phase + omega s,   dx/ds = f
///
/// N directions of derivative (0: values only), of first or second order. The side of the switching surface is frozen
/// during a step.
template <Model M, std::size_t N, std::size_t order = 1>
struct Field {
    using T = Scalar<N, order>;
    static constexpr std::size_t n = dimension_of<M>;

    [[no_unique_address]] M model;
    Constants<M, T> constants;
    T omega;    ///< 0 for an autonomous model
    T seconds;  ///< per unit of s: 1 / omega, or 1
    double phase;
    Clock clock;
    Side<M> side{};
    const InputSignal* input = nullptr;  ///< of an InputModel; `phase` is then the time at s = 0
    std::size_t piece = 0;               ///< of the input on which the present step lies

    Field(const Values<T, parameter_count_of<M>>& p, double phase_, Clock clock_, const M& model_ = M())
        : model(model_),
          constants(constants_from<M, T>(p, model_)),
          omega(0.0),
          seconds(1.0),
          phase(phase_),
          clock(clock_) {
        if constexpr (ForcedModel<M>) {
            omega = p[M::forcing_frequency];
            if (clock == Clock::phase) seconds = 1.0 / omega;
        }
        if constexpr (SwitchingModel<M>) side = 1.0;
    }

    /// @param s  double, or T where an instant depends on the directions
    template <class S>
    [[nodiscard]] State<T, n> operator()(const State<T, n>& x, const S& s, const Side<M>& on_side) const {
        if constexpr (ForcedModel<M>) {
            if (clock == Clock::phase) {
                State<T, n> f = rhs_of<M, T>(T(phase + s), x, constants, on_side, {}, model);
                for (T& component : f)
                    component = component * seconds;
                return f;
            }
            return rhs_of<M, T>(omega * s + phase, x, constants, on_side, {}, model);
        } else if constexpr (InputModel<M>) {
            constexpr std::size_t count = input_count_of<M>;
            std::array<T, count> u;
            if constexpr (std::is_same_v<S, double>) {
                std::array<double, count> values;
                input->evaluate(piece, phase + s, values.data());
                for (std::size_t i = 0; i < count; ++i)
                    u[i] = T(values[i]);
            } else {
                std::array<double, 3 * count> terms;
                input->expand(piece, phase + value_of(s), terms.data());
                const S later = s - value_of(s);
                for (std::size_t i = 0; i < count; ++i)
                    u[i] = terms[3 * i] + later * (terms[3 * i + 1] + later * terms[3 * i + 2]);
            }
            return rhs_of<M, T>(T(phase + s), x, constants, on_side, u, model);
        } else {
            return rhs_of<M, T>(T(s), x, constants, on_side, {}, model);
        }
    }
    template <class S>
    [[nodiscard]] State<T, n> operator()(const State<T, n>& x, const S& s) const {
        return (*this)(x, s, side);
    }
};

}  // namespace orbid::models

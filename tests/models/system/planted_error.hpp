#pragma once

#include <array>
#include <cstddef>
#include <type_traits>

#include "models/definition/model.hpp"

namespace orbid::tests {

/// The part of a model whose derivative is spoilt.
enum class Part { equations, reset, surface };

/// One wrong entry of a matrix of derivatives: that of one output with respect to one input, times a factor. 0 loses
/// it, -1 turns its sign.
struct PlantedError {
    Part part = Part::equations;
    std::size_t output = 0;
    std::size_t input = 0;  ///< the coordinates, then what rhs() gets as constants
    double factor = 1.0;    ///< 1: nothing is wrong
};

/// A model of which one entry is wrong; its values are untouched. The error is chosen at run time, for one compiled
/// model: a test sets it before each check, in one thread.
template <class M>
struct Spoilt : M {
    static constexpr bool packs = false;
    static inline PlantedError error;

    template <class T>
    using X = models::State<T, models::dimension_of<M>>;
    template <class T>
    using C = models::Constants<M, T>;

protected:
    /// The output of the error comes from an input whose derivatives are multiplied by the factor.
    template <class T, class F>
    static auto with_error(Part part, const F& function, const X<T>& x, const C<T>& c) {
        auto value = function(x, c);
        if constexpr (!std::is_same_v<T, double>) {
            if (error.part == part && error.factor != 1.0 && error.output < value.size()) {
                X<T> at = x;
                C<T> with = c;
                T& changed = error.input < x.size() ? at[error.input] : with[error.input - x.size()];
                using models::value_of;
                const T constant(value_of(changed));
                changed = constant + T(error.factor) * (changed - constant);
                value[error.output] = function(at, with)[error.output];
            }
        }
        return value;
    }
};

/// Of a flow.
template <class M>
struct SpoiltFlow : Spoilt<M> {
    template <class T, class... More>
    requires requires(const T& t, const models::State<T, models::dimension_of<M>>& x, const models::Constants<M, T>& c,
                      const More&... more) {
        M::rhs(t, x, c, more...);
    }
    static models::State<T, models::dimension_of<M>> rhs(const T& t, const models::State<T, models::dimension_of<M>>& x,
                                                         const models::Constants<M, T>& c, const More&... more) {
        return Spoilt<M>::template with_error<T>(
            Part::equations, [&](const auto& at, const auto& with) { return M::rhs(t, at, with, more...); }, x, c);
    }
};

/// Of a map.
template <class M>
struct SpoiltMap : Spoilt<M> {
    template <class T>
    static models::State<T, models::dimension_of<M>> map(const models::State<T, models::dimension_of<M>>& x,
                                                         const models::Constants<M, T>& c) {
        return Spoilt<M>::template with_error<T>(
            Part::equations, [](const auto& at, const auto& with) { return M::map(at, with); }, x, c);
    }
};

/// Of a flow with impacts: when they come, and what they do.
template <class M>
struct SpoiltImpacts : SpoiltFlow<M> {
    template <class T>
    static auto surfaces(const T& t, const models::State<T, models::dimension_of<M>>& x,
                         const models::Constants<M, T>& c) {
        return Spoilt<M>::template with_error<T>(
            Part::surface, [&](const auto& at, const auto& with) { return M::surfaces(t, at, with); }, x, c);
    }
    template <class T>
    static models::State<T, models::dimension_of<M>> reset(std::size_t surface, const T& t,
                                                           const models::State<T, models::dimension_of<M>>& x,
                                                           const models::Constants<M, T>& c) {
        return Spoilt<M>::template with_error<T>(
            Part::reset, [&](const auto& at, const auto& with) { return M::reset(surface, t, at, with); }, x, c);
    }
};

}  // namespace orbid::tests

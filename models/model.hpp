#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <string_view>
#include <tuple>
#include <type_traits>

#include "models/dual.hpp"
#include "models/parameter.hpp"

namespace orbid::models {

/// State of a system with n coordinates.
template <class T, std::size_t n>
using State = std::array<T, n>;

/// Values of q parameters (or constants reduced from them), in the order of the model's table.
template <class T, std::size_t q>
using Values = std::array<T, q>;

/// Numbers of coordinates and parameters of a model.
template <class M>
inline constexpr std::size_t dimension_of = std::tuple_size_v<std::remove_cvref_t<decltype(M::coordinates)>>;
template <class M>
inline constexpr std::size_t parameter_count_of = std::tuple_size_v<std::remove_cvref_t<decltype(M::parameters)>>;

template <class M>
concept ModelTables = requires {
    { M::coordinates[0] } -> std::convertible_to<const Coordinate&>;
    { M::parameters[0] } -> std::convertible_to<const Parameter&>;
    requires dimension_of<M> >
    0;
    requires parameter_count_of<M> >
    0;
};

/// The equations read constants that are reduced from the parameters once per flow: quotients and products that would
/// otherwise be computed at every evaluation. `rhs` then takes these constants in the place of the parameters.
template <class M>
concept ReducedModel = ModelTables<M> && requires(const Values<double, parameter_count_of<M>>& p) {
    {M::reduced(p)};
};

namespace detail {
template <class M, class T>
struct ConstantsOf {
    using type = Values<T, parameter_count_of<M>>;
};
template <ReducedModel M, class T>
struct ConstantsOf<M, T> {
    using type = decltype(M::reduced(std::declval<const Values<T, parameter_count_of<M>>&>()));
};
}  // namespace detail

/// What the right hand side reads: the parameters themselves, or the constants reduced from them.
template <class M, class T>
using Constants = typename detail::ConstantsOf<M, T>::type;

template <class M, class T>
Constants<M, T> constants_from(const Values<T, parameter_count_of<M>>& p) {
    if constexpr (ReducedModel<M>)
        return M::reduced(p);
    else
        return p;
}

namespace detail {
template <class M, class T>
concept PlainRhs = requires(const T& t, const State<T, dimension_of<M>>& x, const Constants<M, T>& c) {
    { M::rhs(t, x, c) } -> std::same_as<State<T, dimension_of<M>>>;
};
template <class M, class T>
concept OneSidedRhs = requires(const T& t, const State<T, dimension_of<M>>& x, const Constants<M, T>& c, double side) {
    { M::rhs(t, x, c, side) } -> std::same_as<State<T, dimension_of<M>>>;
};
}  // namespace detail

/// x' = f(x, t; theta), as one struct that holds the tables `coordinates` and `parameters` and the equations as a
/// function template `rhs` on the scalar. The first argument of rhs is the phase omega t [rad] for a forced model, and
/// is not to be used otherwise. What the compiler cannot check: rhs is pure, and never throws.
template <class M>
concept Model = ModelTables<M> &&((detail::PlainRhs<M, double> && detail::PlainRhs<M, Dual<2>>) ||
                                  (detail::OneSidedRhs<M, double> && detail::OneSidedRhs<M, Dual<2>>));

/// f depends on time through a phase of period 2 pi; `forcing_frequency` is the index of omega [rad/s] in the
/// parameter table (a positive parameter).
template <class M>
concept ForcedModel = Model<M> && requires {
    { M::forcing_frequency } -> std::convertible_to<std::size_t>;
    requires M::forcing_frequency < parameter_count_of<M>;
    requires M::parameters[M::forcing_frequency].domain == Domain::positive;
};

/// One degree of freedom (position, velocity) with friction: the acceleration jumps where the velocity changes sign.
/// rhs takes the side, +1 or -1, as its last argument and puts it wherever the equations say sgn(velocity), also in
/// |velocity| = side velocity, so that it is smooth across the surface. What the compiler cannot check: position' =
/// velocity, and friction opposes the motion (acceleration on side +1 <= acceleration on side -1 at velocity 0).
template <class M>
concept SwitchingModel =
    Model<M> && detail::OneSidedRhs<M, double> && detail::OneSidedRhs<M, Dual<2>> && dimension_of<M>
== 2 && requires(const Values<double, parameter_count_of<M>>& p) {
    { M::smooth(p) } -> std::same_as<bool>;  ///< no jump in f at these parameters
};

/// x -> diag(symmetry_signs) x maps solutions at phase tau to solutions at tau + symmetry_phase_shift [rad].
template <class M>
concept SymmetricModel = Model<M> && requires {
    { M::symmetry_signs } -> std::convertible_to<const std::array<double, dimension_of<M>>&>;
    { M::symmetry_phase_shift } -> std::convertible_to<double>;
};

/// What the instrument reads is not the plain state (an encoder with an offset): readings = instrument(x, p).
template <class M>
concept InstrumentModel = Model<M> &&
    requires(const State<Dual<2>, dimension_of<M>>& x, const Values<Dual<2>, parameter_count_of<M>>& p) {
    { M::instrument(x, p) } -> std::same_as<State<Dual<2>, dimension_of<M>>>;
};

/// One of several forms of the same model.
template <class M>
concept VariantModel = Model<M> && requires {
    { M::variant } -> std::convertible_to<std::string_view>;
};

/// Can be put into the registry.
template <class M>
concept DescribedModel = Model<M> && requires {
    { M::name } -> std::convertible_to<std::string_view>;
    { M::summary } -> std::convertible_to<std::string_view>;
    { M::equations } -> std::convertible_to<std::string_view>;
};

/// The right hand side with the side where the model has one.
template <Model M, class T>
State<T, dimension_of<M>> rhs_of(const T& t, const State<T, dimension_of<M>>& x, const Constants<M, T>& c,
                                 [[maybe_unused]] double side) {
    if constexpr (SwitchingModel<M>)
        return M::rhs(t, x, c, side);
    else
        return M::rhs(t, x, c);
}

/// Index of the velocity in a switching model.
inline constexpr std::size_t velocity = 1;

}  // namespace orbid::models

#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <span>
#include <string_view>
#include <tuple>
#include <type_traits>

#include "models/arithmetic/dual.hpp"
#include "models/definition/parameter.hpp"

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
    requires(dimension_of<M> > 0);
    requires(parameter_count_of<M> > 0);
};

/// The equations read constants that are reduced from the parameters once per flow. They are quotients and products
/// that would otherwise be computed at every evaluation. `rhs` then takes these constants in the place of the
/// parameters.
template <class M>
concept ReducedModel = ModelTables<M> && requires(const M& model, const Values<double, parameter_count_of<M>>& p) {
    {model.reduced(p)};
};

namespace detail {
template <class M, class T>
struct ConstantsOf {
    using type = Values<T, parameter_count_of<M>>;
};
template <ReducedModel M, class T>
struct ConstantsOf<M, T> {
    using type = decltype(std::declval<const M&>().reduced(std::declval<const Values<T, parameter_count_of<M>>&>()));
};
}  // namespace detail

/// What the right hand side reads: the parameters themselves, or the constants reduced from them.
template <class M, class T>
using Constants = typename detail::ConstantsOf<M, T>::type;

template <class M, class T>
Constants<M, T> constants_from(const Values<T, parameter_count_of<M>>& p, [[maybe_unused]] const M& model = M()) {
    if constexpr (ReducedModel<M>)
        return model.reduced(p);
    else
        return p;
}

/// Measured inputs u(t) beside the state: a table `inputs` of their names and units. rhs takes their values, an array
/// of the scalar, as its last argument. Its first argument is then the time t [s] on the clock of the signal.
template <class M>
concept InputTable = ModelTables<M> && requires {
    { M::inputs[0] } -> std::convertible_to<const Coordinate&>;
};

/// Several switching surfaces h_j(t, x; theta) = 0: `surface_count` of them, whose values `surfaces` returns. rhs takes
/// an array of sides, +1 or -1 for each surface, and is smooth across all of them.
template <class M>
concept SurfaceTable = ModelTables<M> && requires {
    { M::surface_count } -> std::convertible_to<std::size_t>;
    requires(M::surface_count > 0);
};

/// Numbers of measured inputs and of switching surfaces beside the velocity's.
template <class M>
inline constexpr std::size_t input_count_of = 0;
template <InputTable M>
inline constexpr std::size_t input_count_of<M> = M::inputs.size();
template <class M>
inline constexpr std::size_t surface_count_of = 0;
template <SurfaceTable M>
inline constexpr std::size_t surface_count_of<M> = M::surface_count;

/// The sides of the switching surfaces on which the equations are evaluated. One number for a SwitchingModel (and for
/// models that ignore it), an array for a SurfaceModel.
template <class M>
using Side = std::conditional_t<SurfaceTable<M>, std::array<double, surface_count_of<M>>, double>;

namespace detail {
template <class M, class T, class... Extra>
concept RhsTaking = requires(const M& model, const T& t, const State<T, dimension_of<M>>& x, const Constants<M, T>& c,
                             const Extra&... extra) {
    { model.rhs(t, x, c, extra...) } -> std::same_as<State<T, dimension_of<M>>>;
};
/// rhs without a side.
template <class M, class T>
concept PlainRhs = (input_count_of<M> == 0 && RhsTaking<M, T>) ||
                   (input_count_of<M> > 0 && RhsTaking<M, T, std::array<T, input_count_of<M>>>);
/// rhs with a side, or sides.
template <class M, class T>
concept OneSidedRhs = (input_count_of<M> == 0 && RhsTaking<M, T, Side<M>>) ||
                      (input_count_of<M> > 0 && RhsTaking<M, T, Side<M>, std::array<T, input_count_of<M>>>);
}  // namespace detail

/// x -> F(x; theta): a function template `map` in the place of rhs.
template <class M>
concept MapModel = ModelTables<M> &&
    requires(const M& model, const State<double, dimension_of<M>>& x, const Constants<M, double>& c,
             const State<Dual<2>, dimension_of<M>>& dual_x, const Constants<M, Dual<2>>& dual_c) {
    { model.map(x, c) } -> std::same_as<State<double, dimension_of<M>>>;
    { model.map(dual_x, dual_c) } -> std::same_as<State<Dual<2>, dimension_of<M>>>;
};

/// x' = f(x, t; theta), as one struct. It holds the tables `coordinates` and `parameters`, and the equations as a
/// function template `rhs` on the scalar. For a forced model the first argument of rhs is the phase omega t [rad];
/// other models must not use it (but see InputTable). Or a map. What the compiler cannot check: rhs is pure, and never
/// throws.
///
/// What computes with M takes a model as its last argument, M() by default: an empty struct where all members are
/// static. Equations known at run time only are const members of an object (InterpretedShape).
template <class M>
concept Model = MapModel<M> ||(ModelTables<M> && ((detail::PlainRhs<M, double> && detail::PlainRhs<M, Dual<2>>) ||
                                                  (detail::OneSidedRhs<M, double> && detail::OneSidedRhs<M, Dual<2>>)));

/// Reads measured inputs. Forced models have a clock of their own and read none.
template <class M>
concept InputModel = Model<M> && InputTable<M> && !requires {
    M::forcing_frequency;
};

/// Slow and fast scales far apart (`stiff = true`): steps are taken by an implicit method.
template <class M>
concept StiffModel = Model<M> && !MapModel<M> && requires {
    requires M::stiff;
};

/// f depends on time through a phase of period 2 pi; `forcing_frequency` is the index of omega [rad/s] in the
/// parameter table (a positive parameter).
template <class M>
concept ForcedModel = Model<M> && requires {
    { M::forcing_frequency } -> std::convertible_to<std::size_t>;
    requires M::forcing_frequency < parameter_count_of<M>;
    requires M::parameters[M::forcing_frequency].domain == Domain::positive;
};

/// One degree of freedom (position, velocity) with friction: the acceleration jumps where the velocity changes sign.
/// rhs takes the side, +1 or -1, as its last argument. The side replaces sgn(velocity) everywhere in the equations,
/// also in |velocity| = side velocity, so that rhs is smooth across the surface. `const auto& side` lets the
/// trajectories of a pack have sides of their own. What the compiler cannot check: position' = velocity, and friction
/// opposes the motion (acceleration on side +1 <= acceleration on side -1 at velocity 0).
template <class M>
concept SwitchingModel =
    Model<M> && !SurfaceTable<M> && !MapModel<M> && detail::OneSidedRhs<M, double> && detail::OneSidedRhs<M, Dual<2>> &&
    dimension_of<M> == 2 && requires(const M& model, const Values<double, parameter_count_of<M>>& p) {
    { model.smooth(p) } -> std::same_as<bool>;  ///< no jump in f at these parameters
};

/// General switching surfaces: f jumps, or the state does, where h_j(t, x; theta) passes zero.
///
///     surfaces(t, x, c)        values of all h_j
///     rhs(t, x, c, sides)      f on the sides +1 (h_j > 0) or -1, smooth across every surface
///     impacts                  optional, std::array<bool, surface_count>: where true, the state jumps when h_j falls
///     to
///                              zero, x+ = reset(j, t, x, c), and the solution stays on the side h_j > 0
///
/// Where both one-sided fields point at a surface, the solution slides along it (Filippov). What the compiler cannot
/// check: h_j is differentiable, and f+ and f- are transversal to it except at isolated points.
template <class M>
concept SurfaceModel = Model<M> && SurfaceTable<M> && !SwitchingModel<M> &&
                       requires(const M& model, const double& t, const State<double, dimension_of<M>>& x,
                                const Constants<M, double>& c, const Values<double, parameter_count_of<M>>& p) {
    { model.surfaces(t, x, c) } -> std::same_as<Values<double, surface_count_of<M>>>;
    { model.smooth(p) } -> std::same_as<bool>;
};

/// Some surfaces are impacts: the state jumps there.
template <class M>
concept ImpactModel = SurfaceModel<M> &&
    requires(const M& model, const double& t, const State<double, dimension_of<M>>& x, const Constants<M, double>& c) {
    { M::impacts } -> std::convertible_to<const std::array<bool, surface_count_of<M>>&>;
    { model.reset(std::size_t{}, t, x, c) } -> std::same_as<State<double, dimension_of<M>>>;
};

/// x -> diag(symmetry_signs) x maps solutions at phase tau to solutions at tau + symmetry_phase_shift [rad].
template <class M>
concept SymmetricModel = Model<M> && requires {
    { M::symmetry_signs } -> std::convertible_to<const std::array<double, dimension_of<M>>&>;
    { M::symmetry_phase_shift } -> std::convertible_to<double>;
};

/// What the instrument reads is not the plain state (an encoder with an offset): readings = instrument(x, p).
template <class M>
concept InstrumentModel = Model<M> && requires(const M& model, const State<Dual<2>, dimension_of<M>>& x,
                                               const Values<Dual<2>, parameter_count_of<M>>& p) {
    { model.instrument(x, p) } -> std::same_as<State<Dual<2>, dimension_of<M>>>;
};

/// One of several forms of the same model.
template <class M>
concept VariantModel = Model<M> && requires {
    { M::variant } -> std::convertible_to<std::string_view>;
};

namespace detail {
template <class M>
concept Texts = requires {
    { M::name } -> std::convertible_to<std::string_view>;
    { M::summary } -> std::convertible_to<std::string_view>;
    { M::equations } -> std::convertible_to<std::string_view>;
};
}  // namespace detail

/// Can be registered.
template <class M>
concept DescribedModel = Model<M> && detail::Texts<M>;

/// x' = f(x; theta) for a number n of equal cells that is chosen at run time, such as a ring. Instead of a table of
/// coordinates it has the one `coordinate` of a cell, whose name is numbered from 1 (x1, ..., xn). It also has
/// `smallest_size`, `default_size`, and equations that write f for x.size() cells:
///
///     template <class T>
///     static void rhs(const T& t, std::span<const T> x, const Values<T, q>& p, std::span<T> f)
///
/// Autonomous, smooth, not stiff. What the compiler cannot check: rhs is pure, writes all of f, and never throws.
template <class M>
concept DynamicModel = requires(const M& model, const double& t, std::span<const double> x, std::span<double> f,
                                const Dual<2>& dual_t, std::span<const Dual<2>> dual_x, std::span<Dual<2>> dual_f) {
    { M::coordinate } -> std::convertible_to<const Coordinate&>;
    { M::parameters[0] } -> std::convertible_to<const Parameter&>;
    requires(parameter_count_of<M> > 0);
    { M::smallest_size } -> std::convertible_to<std::size_t>;
    { M::default_size } -> std::convertible_to<std::size_t>;
    requires(M::smallest_size > 0 && M::smallest_size <= M::default_size);
    { model.rhs(t, x, Values<double, parameter_count_of<M>>{}, f) } -> std::same_as<void>;
    { model.rhs(dual_t, dual_x, Values<Dual<2>, parameter_count_of<M>>{}, dual_f) } -> std::same_as<void>;
    requires !ModelTables<M> && detail::Texts<M>;
};

/// The right hand side, with the side where the model has one and the inputs where it reads some.
template <Model M, class T>
State<T, dimension_of<M>> rhs_of(const T& t, const State<T, dimension_of<M>>& x, const Constants<M, T>& c,
                                 [[maybe_unused]] const Side<M>& side,
                                 [[maybe_unused]] const std::array<T, input_count_of<M>>& u = {},
                                 const M& model = M()) {
    constexpr bool sided = SwitchingModel<M> || SurfaceModel<M>;
    if constexpr (sided && InputModel<M>)
        return model.rhs(t, x, c, side, u);
    else if constexpr (sided)
        return model.rhs(t, x, c, side);
    else if constexpr (InputModel<M>)
        return model.rhs(t, x, c, u);
    else
        return model.rhs(t, x, c);
}

/// Index of the velocity in a switching model.
inline constexpr std::size_t velocity = 1;

}  // namespace orbid::models

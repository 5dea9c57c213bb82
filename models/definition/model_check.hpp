#pragma once

#include <string_view>
#include <tuple>
#include <type_traits>

#include "models/definition/model_members.hpp"

namespace orbid::models {

// Tells in one sentence what a model lacks. The concepts of model.hpp are asked in the order in which an author would
// meet them. The first that fails ends the compilation with its text, so there is one error instead of a page.
// clang-format off: one question, one answer

/// Texts and the table of parameters.
template <class M>
consteval bool texts_and_parameters_are_complete() {
    using namespace detail;
    if constexpr (!HasName<M>)
        static_assert(never<M>, "a model needs its name as jobs write it: "
                                "static constexpr std::string_view name = \"...\" (docs/adding_a_model.md)");
    else if constexpr (!is_name(M::name))
        static_assert(never<M>, "the name of a model must be letters, digits and _, not beginning with a digit "
                                "(docs/adding_a_model.md)");
    else if constexpr (!HasSummary<M>)
        static_assert(never<M>, "a model needs a summary of one line: "
                                "static constexpr std::string_view summary = \"...\" (docs/adding_a_model.md)");
    else if constexpr (!HasEquations<M>)
        static_assert(never<M>, "a model needs its equations as text: "
                                "static constexpr std::string_view equations = \"...\" (docs/adding_a_model.md)");
    else if constexpr (!HasParameters<M>)
        static_assert(never<M>, "a model needs a table of its parameters: static constexpr std::array "
                                "parameters{Parameter{\"c\", \"1/s\", nonnegative, 0.1, \"damping\"}} "
                                "(docs/adding_a_model.md)");
    else if constexpr (!table_of<M::parameters, Parameter>)
        static_assert(never<M>, "parameters must be a std::array of one or more Parameter (docs/adding_a_model.md)");
    else if constexpr (!are_names(M::parameters))
        static_assert(never<M>, "names of parameters must differ and be letters, digits and _, not beginning with a "
                                "digit (docs/adding_a_model.md)");
    else if constexpr (!defaults_in_domain(M::parameters))
        static_assert(never<M>, "the default of a parameter must lie in its domain (docs/adding_a_model.md)");
    else if constexpr (!have_sizes(M::parameters))
        static_assert(never<M>, "a parameter whose default is 0 needs typical(size), how large it usually is "
                                "(docs/adding_a_model.md)");
    else
        return true;
    return false;
}

/// A model whose number of coordinates is chosen at run time.
template <class M>
consteval bool dynamic_model_is_complete() {
    using namespace detail;
    if constexpr (HasCoordinates<M>)
        static_assert(never<M>, "a model has a table `coordinates`, or one `coordinate` with smallest_size and "
                                "default_size, not both (docs/adding_a_model.md)");
    else if constexpr (!HasCell<M>)
        static_assert(never<M>, "a model of any size needs what one of its cells holds: static constexpr Coordinate "
                                "coordinate = real(\"x\", \"m\") (docs/adding_a_model.md)");
    else if constexpr (!HasSizes<M>)
        static_assert(never<M>, "a model of any size needs static constexpr std::size_t smallest_size and default_size "
                                "(docs/adding_a_model.md)");
    else if constexpr (!(M::smallest_size > 0 && M::smallest_size <= M::default_size))
        static_assert(never<M>, "sizes must be 0 < smallest_size <= default_size (docs/adding_a_model.md)");
    else if constexpr (HasMap<M> || HasFrequency<M> || HasInputs<M> || HasSurfaceCount<M> || HasSmooth<M> ||
                       HasStiff<M> || HasSigns<M> || HasInstrument<M> || HasReduced<M> || HasVariant<M>)
        static_assert(never<M>, "a model of any size is autonomous, smooth and not stiff: it has rhs, and no map, "
                                "forcing_frequency, inputs, surfaces, smooth, stiff, symmetry_signs, instrument, "
                                "reduced or variant (docs/adding_a_model.md)");
    else if constexpr (!HasRhs<M>)
        static_assert(never<M>, "a model needs its equations: template <class T> static void rhs(const T& t, "
                                "std::span<const T> x, const Values<T, q>& p, std::span<T> f) "
                                "(docs/adding_a_model.md)");
    else if constexpr (!DynamicModel<M>)
        static_assert(never<M>, "rhs of a model of any size must be template <class T> static void rhs(const T& t, "
                                "std::span<const T> x, const Values<T, q>& p, std::span<T> f), q as in the table of "
                                "parameters (docs/adding_a_model.md)");
    else
        return true;
    return false;
}

/// Coordinates, and equations that fit the tables: a map.
template <class M>
consteval bool map_is_complete() {
    using namespace detail;
    if constexpr (HasRhs<M>)
        static_assert(never<M>, "a model has rhs, x' = f, or map, x -> F, not both (docs/adding_a_model.md)");
    else if constexpr (HasFrequency<M> || HasInputs<M> || HasSurfaceCount<M> || HasSmooth<M> || HasStiff<M>)
        static_assert(never<M>, "a map has no forcing_frequency, inputs, surfaces, smooth or stiff: these belong to "
                                "rhs (docs/adding_a_model.md)");
    else if constexpr (!CallableMap<M, double>)
        static_assert(never<M>, "map cannot be called as map(x, p): State<T, n> and Values<T, q> must have the lengths "
                                "of the tables coordinates and parameters (docs/adding_a_model.md)");
    else if constexpr (!MapTaking<M, double>)
        static_assert(never<M>, "map must return State<T, n>, n as in the table of coordinates "
                                "(docs/adding_a_model.md)");
    else if constexpr (!MapModel<M>)
        static_assert(never<M>, "map takes numbers but not numbers with derivatives: template <class T> static "
                                "State<T, n> map(const State<T, n>& x, const Values<T, q>& p) "
                                "(docs/adding_a_model.md)");
    else
        return true;
    return false;
}

/// Members beside the equations of a flow, which decide their arguments.
template <class M>
consteval bool tables_of_flow_are_complete() {
    using namespace detail;
    if constexpr (HasInputs<M> && HasFrequency<M>)
        static_assert(never<M>, "a model has forcing_frequency or inputs, not both: the first argument of rhs is a "
                                "phase or a time (docs/adding_a_model.md)");
    else if constexpr (HasInputs<M> && !InputTable<M>)
        static_assert(never<M>, "inputs must be a std::array of names with units: static constexpr std::array "
                                "inputs{real(\"u\", \"N\")} (docs/adding_a_model.md)");
    else if constexpr (HasFrequency<M> && !FrequencyIsIndex<M>)
        static_assert(never<M>, "forcing_frequency must be the index of a parameter, below their number "
                                "(docs/adding_a_model.md)");
    else if constexpr (HasFrequency<M> && !FrequencyIsPositive<M>)
        static_assert(never<M>, "the parameter at forcing_frequency must be positive: a forcing of frequency 0 has no "
                                "period (docs/adding_a_model.md)");
    else if constexpr (HasSurfaceCount<M> && !SurfaceTable<M>)
        static_assert(never<M>, "surface_count must be a number > 0 (docs/adding_a_model.md)");
    else if constexpr (HasSurfaceCount<M> && !HasSurfaces<M>)
        static_assert(never<M>, "surface_count says that there are switching surfaces: surfaces(t, x, p) must return "
                                "their values (docs/adding_a_model.md)");
    else if constexpr (HasSurfaces<M> && !HasSurfaceCount<M>)
        static_assert(never<M>, "surfaces(t, x, p) is there: surface_count must say how many "
                                "(docs/adding_a_model.md)");
    else if constexpr (HasSurfaceCount<M> && !HasSmooth<M>)
        static_assert(never<M>, "a model with surfaces needs smooth(p), true at parameters at which neither f nor the "
                                "state jumps (docs/adding_a_model.md)");
    else if constexpr (HasSmooth<M> && !SmoothAnswers<M>)
        static_assert(never<M>, "smooth must be static bool smooth(const Values<double, q>& p) "
                                "(docs/adding_a_model.md)");
    else if constexpr (HasPacks<M> && !PacksAnswers<M>)
        static_assert(never<M>, "packs must be true or false (docs/adding_a_model.md)");
    else if constexpr (HasStiff<M> && !StiffAnswers<M>)
        static_assert(never<M>, "stiff must be true or false (docs/adding_a_model.md)");
    else
        return true;
    return false;
}

/// Equations of a flow that fit the tables.
template <class M>
consteval bool rhs_is_complete() {
    using namespace detail;
    constexpr bool sided = HasSmooth<M>;
    if constexpr (!sided && !CallablePlain<M, double> && CallableSided<M, double>)
        static_assert(never<M>, "rhs takes a side, so smooth(p) must say at which parameters f does not jump "
                                "(docs/adding_a_model.md)");
    else if constexpr (input_count_of<M> > 0 && !CallablePlain<M, double> && !CallableSided<M, double> &&
                       (Callable<M, double> || Callable<M, double, Side<M>>))
        static_assert(never<M>, "there is a table of inputs: rhs must take their values, std::array<T, m>, as its last "
                                "argument (docs/adding_a_model.md)");
    else if constexpr (sided && !CallableSided<M, double> && CallablePlain<M, double>)
        static_assert(never<M>, "smooth(p) says that f may jump: rhs must take the side, as its last argument before "
                                "inputs (docs/adding_a_model.md)");
    else if constexpr (SurfaceTable<M> && !CallableSided<M, double> && Callable<M, double, double>)
        static_assert(never<M>, "rhs of a model with surfaces must take all sides, std::array<double, surface_count> "
                                "(docs/adding_a_model.md)");
    else if constexpr (!(sided ? CallableSided<M, double> : CallablePlain<M, double>))
        static_assert(never<M>, "rhs cannot be called as rhs(t, x, p): State<T, n> and Values<T, q> must have the "
                                "lengths of the tables coordinates and parameters (docs/adding_a_model.md)");
    else if constexpr (!(sided ? OneSidedRhs<M, double> : PlainRhs<M, double>))
        static_assert(never<M>, "rhs must return State<T, n>, one derivative for each of the coordinates "
                                "(docs/adding_a_model.md)");
    else if constexpr (!(sided ? OneSidedRhs<M, Dual<2>> : PlainRhs<M, Dual<2>>))
        static_assert(never<M>, "rhs takes numbers but not numbers with derivatives: template <class T> static "
                                "State<T, n> rhs(const T& t, const State<T, n>& x, const Values<T, q>& p) "
                                "(docs/adding_a_model.md)");
    else if constexpr (sided && !SurfaceTable<M> && dimension_of<M> != 2)
        static_assert(never<M>, "the one side of friction is for two coordinates, position and velocity; other "
                                "models name their surfaces (docs/adding_a_model.md)");
    else if constexpr (SurfaceTable<M> && !SurfaceModel<M>)
        static_assert(never<M>, "surfaces(t, x, p) must return Values<T, surface_count> (docs/adding_a_model.md)");
    else if constexpr (HasImpacts<M> && !HasReset<M>)
        static_assert(never<M>, "impacts says that the state jumps: reset(j, t, x, p) must return the state after "
                                "impact j (docs/adding_a_model.md)");
    else if constexpr (HasReset<M> && !HasImpacts<M>)
        static_assert(never<M>, "reset(j, t, x, p) is there: impacts, a std::array<bool, surface_count>, must say at "
                                "which surfaces the state jumps (docs/adding_a_model.md)");
    else if constexpr (HasImpacts<M> && !ImpactModel<M>)
        static_assert(never<M>, "impacts must be a std::array<bool, surface_count>, and reset(j, t, x, p) return "
                                "State<T, n> (docs/adding_a_model.md)");
    else if constexpr (HasForcing<M> != HasRhsForced<M>)
        static_assert(never<M>, "forcing(phase, p) and rhs_forced(forcing, x, p, side) go together "
                                "(docs/adding_a_model.md)");
    else
        return true;
    return false;
}

template <class M>
consteval bool equations_are_complete() {
    if constexpr (detail::HasMap<M>)
        return map_is_complete<M>();
    else if constexpr (!tables_of_flow_are_complete<M>())
        return false;
    else
        return rhs_is_complete<M>();
}

/// Optional members of any model.
template <class M>
consteval bool extras_are_complete() {
    using namespace detail;
    if constexpr (HasShift<M> && !HasSigns<M>)
        static_assert(never<M>, "symmetry_phase_shift is there: symmetry_signs must say which coordinates change sign "
                                "(docs/adding_a_model.md)");
    else if constexpr (HasSigns<M> && !HasShift<M>)
        static_assert(never<M>, "symmetry_signs is there: symmetry_phase_shift must say how much later [rad], 0 unless "
                                "forced (docs/adding_a_model.md)");
    else if constexpr (HasSigns<M> && !SymmetricModel<M>)
        static_assert(never<M>, "symmetry_signs must have one sign for each coordinate: static constexpr "
                                "std::array<double, n> symmetry_signs{...} (docs/adding_a_model.md)");
    else if constexpr (!signs_are_one<M>())
        static_assert(never<M>, "symmetry_signs must be 1 or -1 (docs/adding_a_model.md)");
    else if constexpr (HasSigns<M> && !HasFrequency<M> && !ShiftIsZero<M>)
        static_assert(never<M>, "symmetry_phase_shift must be 0 for a model that is not forced "
                                "(docs/adding_a_model.md)");
    else if constexpr (HasInstrument<M> && !InstrumentModel<M>)
        static_assert(never<M>, "instrument must be template <class T> static State<T, n> instrument(const State<T, "
                                "n>& x, const Values<T, q>& p) (docs/adding_a_model.md)");
    else if constexpr (HasVariant<M> && !VariantModel<M>)
        static_assert(never<M>, "variant must be a name: static constexpr std::string_view variant = \"...\" "
                                "(docs/adding_a_model.md)");
    else if constexpr (!variant_is_name<M>())
        static_assert(never<M>, "the name of a variant must be letters, digits and _, not beginning with a digit "
                                "(docs/adding_a_model.md)");
    else
        return true;
    return false;
}

/// One form of a model.
template <class M>
consteval bool one_model_is_complete() {
    using namespace detail;
    if constexpr (!texts_and_parameters_are_complete<M>())
        return false;
    else if constexpr (MentionsSize<M>)
        return dynamic_model_is_complete<M>();
    else if constexpr (!HasCoordinates<M>)
        static_assert(never<M>, "a model needs a table of its coordinates: static constexpr std::array "
                                "coordinates{angle(\"phi\", \"rad\"), real(\"phi_dot\", \"rad/s\")} "
                                "(docs/adding_a_model.md)");
    else if constexpr (!table_of<M::coordinates, Coordinate>)
        static_assert(never<M>, "coordinates must be a std::array of one or more angle(name, unit) or real(name, unit) "
                                "(docs/adding_a_model.md)");
    else if constexpr (!are_names(M::coordinates))
        static_assert(never<M>, "names of coordinates must differ and be letters, digits and _, not beginning with a "
                                "digit (docs/adding_a_model.md)");
    else if constexpr (!HasRhs<M> && !HasMap<M>)
        static_assert(never<M>, "a model needs its equations: template <class T> static State<T, n> rhs(const T& t, "
                                "const State<T, n>& x, const Values<T, q>& p), or a map (docs/adding_a_model.md)");
    else if constexpr (HasReduced<M> && !ReducedModel<M>)
        static_assert(never<M>, "reduced must be template <class T> static auto reduced(const Values<T, q>& p), q as "
                                "in the table of parameters (docs/adding_a_model.md)");
    else if constexpr (!equations_are_complete<M>())
        return false;
    else
        return extras_are_complete<M>();
    return false;
}

/// Every form of a model, the default first.
template <class First, class... Others>
consteval bool variants_are_complete(std::type_identity<std::tuple<First, Others...>>) {
    using namespace detail;
    if constexpr (!(one_model_is_complete<First>() && ... && one_model_is_complete<Others>()))
        return false;
    else if constexpr (!(HasVariant<First> && ... && HasVariant<Others>))
        static_assert(never<First>, "each of the variants of a model needs the name of its form: static constexpr "
                                    "std::string_view variant = \"...\" (docs/adding_a_model.md)");
    else if constexpr (!are_different({First::variant, Others::variant...}))
        static_assert(never<First>, "variants of a model must have different names (docs/adding_a_model.md)");
    else if constexpr (!((First::name == Others::name) && ...))
        static_assert(never<First>, "variants of a model must share its name (docs/adding_a_model.md)");
    else
        return true;
    return false;
}

/// True for a model that can be compiled and registered. Otherwise the compilation ends with a sentence that says what
/// is missing.
template <class M>
consteval bool is_complete() {
    if constexpr (requires { typename M::variants; })
        return variants_are_complete(std::type_identity<typename M::variants>{});
    else
        return one_model_is_complete<M>();
}

// clang-format on

}  // namespace orbid::models

#pragma once

#include <string_view>
#include <tuple>
#include <type_traits>

#include "models/definition/model_members.hpp"

namespace orbid::models {

// Tells in one sentence what a model lacks. The concepts of model.hpp are asked in the order in which an author would
// meet them. The first that fails ends the compilation with its text, so there is one error instead of a page.
//
// Formatted by hand: one sentence, one condition.
// clang-format off

/// Ends the compilation with this sentence where the condition holds.
#define ORBID_REFUSE(sentence, ...)                                         \
    if constexpr (__VA_ARGS__) {                                            \
        static_assert(never<M>, sentence " (docs/adding_a_model.md)");      \
        return false;                                                       \
    } else

/// Texts and the table of parameters.
template <class M>
consteval bool texts_and_parameters_are_complete() {
    using namespace detail;
    ORBID_REFUSE("a model needs its name as jobs write it: static constexpr std::string_view name = \"...\"",
                 !HasName<M>)
    ORBID_REFUSE("the name of a model must be letters, digits and _, not beginning with a digit", !is_name(M::name))
    ORBID_REFUSE("a model needs a summary of one line: static constexpr std::string_view summary = \"...\"",
                 !HasSummary<M>)
    ORBID_REFUSE("a model needs its equations as text: static constexpr std::string_view equations = \"...\"",
                 !HasEquations<M>)
    ORBID_REFUSE("a model needs a table of its parameters: static constexpr std::array parameters{Parameter{\"c\", "
                 "\"1/s\", nonnegative, 0.1, \"damping\"}}", !HasParameters<M>)
    ORBID_REFUSE("parameters must be a std::array of one or more Parameter", !table_of<M::parameters, Parameter>)
    ORBID_REFUSE("names of parameters must differ and be letters, digits and _, not beginning with a digit",
                 !are_names(M::parameters))
    ORBID_REFUSE("the default of a parameter must lie in its domain", !defaults_in_domain(M::parameters))
    ORBID_REFUSE("a parameter whose default is 0 needs typical(size), how large it usually is",
                 !have_sizes(M::parameters))
    return true;
}

/// A model whose number of coordinates is chosen at run time.
template <class M>
consteval bool dynamic_model_is_complete() {
    using namespace detail;
    ORBID_REFUSE("a model has a table `coordinates`, or one `coordinate` with smallest_size and default_size, not "
                 "both", HasCoordinates<M>)
    ORBID_REFUSE("a model of any size needs what one of its cells holds: static constexpr Coordinate coordinate = "
                 "real(\"x\", \"m\")", !HasCell<M>)
    ORBID_REFUSE("a model of any size needs static constexpr std::size_t smallest_size and default_size", !HasSizes<M>)
    ORBID_REFUSE("sizes must be 0 < smallest_size <= default_size",
                 !(M::smallest_size > 0 && M::smallest_size <= M::default_size))
    ORBID_REFUSE("a model of any size is autonomous, smooth and not stiff: it has rhs, and no map, forcing_frequency, "
                 "inputs, surfaces, smooth, stiff, symmetry_signs, instrument, reduced or variant",
                 HasMap<M> || HasFrequency<M> || HasInputs<M> || HasSurfaceCount<M> || HasSmooth<M> || HasStiff<M> ||
                 HasSigns<M> || HasInstrument<M> || HasReduced<M> || HasVariant<M>)
    ORBID_REFUSE("a model needs its equations: template <class T> static void rhs(const T& t, std::span<const T> x, "
                 "const Values<T, q>& p, std::span<T> f)", !HasRhs<M>)
    ORBID_REFUSE("rhs of a model of any size must be template <class T> static void rhs(const T& t, std::span<const "
                 "T> x, const Values<T, q>& p, std::span<T> f), q as in the table of parameters", !DynamicModel<M>)
    return true;
}

/// Coordinates, and equations that fit the tables: a map.
template <class M>
consteval bool map_is_complete() {
    using namespace detail;
    ORBID_REFUSE("a model has rhs, x' = f, or map, x -> F, not both", HasRhs<M>)
    ORBID_REFUSE("a map has no forcing_frequency, inputs, surfaces, smooth or stiff: these belong to rhs",
                 HasFrequency<M> || HasInputs<M> || HasSurfaceCount<M> || HasSmooth<M> || HasStiff<M>)
    ORBID_REFUSE("map cannot be called as map(x, p): State<T, n> and Values<T, q> must have the lengths of the tables "
                 "coordinates and parameters", !CallableMap<M, double>)
    ORBID_REFUSE("map must return State<T, n>, n as in the table of coordinates", !MapTaking<M, double>)
    ORBID_REFUSE("map takes numbers but not numbers with derivatives: template <class T> static State<T, n> map(const "
                 "State<T, n>& x, const Values<T, q>& p)", !MapModel<M>)
    return true;
}

/// Members beside the equations of a flow, which decide their arguments.
template <class M>
consteval bool tables_of_flow_are_complete() {
    using namespace detail;
    ORBID_REFUSE("a model has forcing_frequency or inputs, not both: the first argument of rhs is a phase or a time",
                 HasInputs<M> && HasFrequency<M>)
    ORBID_REFUSE("inputs must be a std::array of names with units: static constexpr std::array inputs{real(\"u\", "
                 "\"N\")}", HasInputs<M> && !InputTable<M>)
    ORBID_REFUSE("forcing_frequency must be the index of a parameter, below their number",
                 HasFrequency<M> && !FrequencyIsIndex<M>)
    ORBID_REFUSE("the parameter at forcing_frequency must be positive: a forcing of frequency 0 has no period",
                 HasFrequency<M> && !FrequencyIsPositive<M>)
    ORBID_REFUSE("surface_count must be a number > 0", HasSurfaceCount<M> && !SurfaceTable<M>)
    ORBID_REFUSE("surface_count says that there are switching surfaces: surfaces(t, x, p) must return their values",
                 HasSurfaceCount<M> && !HasSurfaces<M>)
    ORBID_REFUSE("surfaces(t, x, p) is there: surface_count must say how many", HasSurfaces<M> && !HasSurfaceCount<M>)
    ORBID_REFUSE("a model with surfaces needs smooth(p), true at parameters at which neither f nor the state jumps",
                 HasSurfaceCount<M> && !HasSmooth<M>)
    ORBID_REFUSE("smooth must be static bool smooth(const Values<double, q>& p)", HasSmooth<M> && !SmoothAnswers<M>)
    ORBID_REFUSE("packs must be true or false", HasPacks<M> && !PacksAnswers<M>)
    ORBID_REFUSE("stiff must be true or false", HasStiff<M> && !StiffAnswers<M>)
    return true;
}

/// Equations of a flow that fit the tables.
template <class M>
consteval bool rhs_is_complete() {
    using namespace detail;
    constexpr bool sided = HasSmooth<M>;
    ORBID_REFUSE("rhs takes a side, so smooth(p) must say at which parameters f does not jump",
                 !sided && !CallablePlain<M, double> && CallableSided<M, double>)
    ORBID_REFUSE("there is a table of inputs: rhs must take their values, std::array<T, m>, as its last argument",
                 input_count_of<M> > 0 && !CallablePlain<M, double> && !CallableSided<M, double> &&
                 (Callable<M, double> || Callable<M, double, Side<M>>))
    ORBID_REFUSE("smooth(p) says that f may jump: rhs must take the side, as its last argument before inputs",
                 sided && !CallableSided<M, double> && CallablePlain<M, double>)
    ORBID_REFUSE("rhs of a model with surfaces must take all sides, std::array<double, surface_count>",
                 SurfaceTable<M> && !CallableSided<M, double> && Callable<M, double, double>)
    ORBID_REFUSE("rhs cannot be called as rhs(t, x, p): State<T, n> and Values<T, q> must have the lengths of the "
                 "tables coordinates and parameters", !(sided ? CallableSided<M, double> : CallablePlain<M, double>))
    ORBID_REFUSE("rhs must return State<T, n>, one derivative for each of the coordinates",
                 !(sided ? OneSidedRhs<M, double> : PlainRhs<M, double>))
    ORBID_REFUSE("rhs takes numbers but not numbers with derivatives: template <class T> static State<T, n> rhs(const "
                 "T& t, const State<T, n>& x, const Values<T, q>& p)",
                 !(sided ? OneSidedRhs<M, Dual<2>> : PlainRhs<M, Dual<2>>))
    ORBID_REFUSE("the one side of friction is for two coordinates, position and velocity; other models name their "
                 "surfaces", sided && !SurfaceTable<M> && dimension_of<M> != 2)
    ORBID_REFUSE("surfaces(t, x, p) must return Values<T, surface_count>", SurfaceTable<M> && !SurfaceModel<M>)
    ORBID_REFUSE("impacts says that the state jumps: reset(j, t, x, p) must return the state after impact j",
                 HasImpacts<M> && !HasReset<M>)
    ORBID_REFUSE("reset(j, t, x, p) is there: impacts, a std::array<bool, surface_count>, must say at which surfaces "
                 "the state jumps", HasReset<M> && !HasImpacts<M>)
    ORBID_REFUSE("impacts must be a std::array<bool, surface_count>, and reset(j, t, x, p) return State<T, n>",
                 HasImpacts<M> && !ImpactModel<M>)
    ORBID_REFUSE("forcing(phase, p) and rhs_forced(forcing, x, p, side) go together", HasForcing<M> != HasRhsForced<M>)
    return true;
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
    ORBID_REFUSE("symmetry_phase_shift is there: symmetry_signs must say which coordinates change sign",
                 HasShift<M> && !HasSigns<M>)
    ORBID_REFUSE("symmetry_signs is there: symmetry_phase_shift must say how much later [rad], 0 unless forced",
                 HasSigns<M> && !HasShift<M>)
    ORBID_REFUSE("symmetry_signs must have one sign for each coordinate: static constexpr std::array<double, n> "
                 "symmetry_signs{...}", HasSigns<M> && !SymmetricModel<M>)
    ORBID_REFUSE("symmetry_signs must be 1 or -1", !signs_are_one<M>())
    ORBID_REFUSE("symmetry_phase_shift must be 0 for a model that is not forced",
                 HasSigns<M> && !HasFrequency<M> && !ShiftIsZero<M>)
    ORBID_REFUSE("instrument must be template <class T> static State<T, n> instrument(const State<T, n>& x, const "
                 "Values<T, q>& p)", HasInstrument<M> && !InstrumentModel<M>)
    ORBID_REFUSE("variant must be a name: static constexpr std::string_view variant = \"...\"",
                 HasVariant<M> && !VariantModel<M>)
    ORBID_REFUSE("the name of a variant must be letters, digits and _, not beginning with a digit",
                 !variant_is_name<M>())
    return true;
}

/// One form of a model.
template <class M>
consteval bool one_model_is_complete() {
    using namespace detail;
    if constexpr (!texts_and_parameters_are_complete<M>())
        return false;
    else if constexpr (MentionsSize<M>)
        return dynamic_model_is_complete<M>();
    else
    ORBID_REFUSE("a model needs a table of its coordinates: static constexpr std::array coordinates{angle(\"phi\", "
                 "\"rad\"), real(\"phi_dot\", \"rad/s\")}", !HasCoordinates<M>)
    ORBID_REFUSE("coordinates must be a std::array of one or more angle(name, unit) or real(name, unit)",
                 !table_of<M::coordinates, Coordinate>)
    ORBID_REFUSE("names of coordinates must differ and be letters, digits and _, not beginning with a digit",
                 !are_names(M::coordinates))
    ORBID_REFUSE("a model needs its equations: template <class T> static State<T, n> rhs(const T& t, const State<T, "
                 "n>& x, const Values<T, q>& p), or a map", !HasRhs<M> && !HasMap<M>)
    ORBID_REFUSE("reduced must be template <class T> static auto reduced(const Values<T, q>& p), q as in the table of "
                 "parameters", HasReduced<M> && !ReducedModel<M>)
    if constexpr (!equations_are_complete<M>())
        return false;
    else
        return extras_are_complete<M>();
}

/// Every form of a model, the default first.
template <class M, class... Others>
consteval bool variants_are_complete(std::type_identity<std::tuple<M, Others...>>) {
    using namespace detail;
    if constexpr (!(one_model_is_complete<M>() && ... && one_model_is_complete<Others>()))
        return false;
    else
    ORBID_REFUSE("each of the variants of a model needs the name of its form: static constexpr std::string_view "
                 "variant = \"...\"", !(HasVariant<M> && ... && HasVariant<Others>))
    ORBID_REFUSE("variants of a model must have different names", !are_different({M::variant, Others::variant...}))
    ORBID_REFUSE("variants of a model must share its name", !((M::name == Others::name) && ...))
    return true;
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

#undef ORBID_REFUSE
// clang-format on

}  // namespace orbid::models

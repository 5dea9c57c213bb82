#pragma once

#include <algorithm>
#include <array>
#include <concepts>
#include <cstddef>
#include <initializer_list>
#include <string_view>
#include <type_traits>

#include "models/definition/model.hpp"

namespace orbid::models {

/// Which members a model has, valid or not: the questions of model_check.hpp.
namespace detail {

/// False for every model, but evaluated only when the template is instantiated.
template <class M>
inline constexpr bool never = false;

/// Names of functions that a model may have. A function is found, whatever its arguments, by adding a second one of
/// that name. The name is then ambiguous, and its address cannot be taken.
struct FunctionNames {
    int rhs, map, smooth, surfaces, reset, instrument, reduced, forcing, rhs_forced;
};
template <class M>
struct NameProbe : M, FunctionNames {};

// clang-format off
template <class M> concept HasRhs = !requires { &NameProbe<M>::rhs; };
template <class M> concept HasMap = !requires { &NameProbe<M>::map; };
template <class M> concept HasSmooth = !requires { &NameProbe<M>::smooth; };
template <class M> concept HasSurfaces = !requires { &NameProbe<M>::surfaces; };
template <class M> concept HasReset = !requires { &NameProbe<M>::reset; };
template <class M> concept HasInstrument = !requires { &NameProbe<M>::instrument; };
template <class M> concept HasReduced = !requires { &NameProbe<M>::reduced; };
template <class M> concept HasForcing = !requires { &NameProbe<M>::forcing; };
template <class M> concept HasRhsForced = !requires { &NameProbe<M>::rhs_forced; };

template <class M> concept HasName = requires { { M::name } -> std::convertible_to<std::string_view>; };
template <class M> concept HasSummary = requires { { M::summary } -> std::convertible_to<std::string_view>; };
template <class M> concept HasEquations = requires { { M::equations } -> std::convertible_to<std::string_view>; };
template <class M> concept HasParameters = requires { M::parameters; };
template <class M> concept HasCoordinates = requires { M::coordinates; };
template <class M> concept HasCell = requires { { M::coordinate } -> std::convertible_to<const Coordinate&>; };
template <class M> concept HasSizes = requires { { M::smallest_size } -> std::convertible_to<std::size_t>;
                                                 { M::default_size } -> std::convertible_to<std::size_t>; };
template <class M> concept MentionsSize = requires { M::coordinate; } || requires { M::smallest_size; } ||
                                          requires { M::default_size; };
template <class M> concept HasFrequency = requires { M::forcing_frequency; };
template <class M> concept HasInputs = requires { M::inputs; };
template <class M> concept HasSurfaceCount = requires { M::surface_count; };
template <class M> concept HasImpacts = requires { M::impacts; };
template <class M> concept HasSigns = requires { M::symmetry_signs; };
template <class M> concept HasShift = requires { M::symmetry_phase_shift; };
template <class M> concept HasStiff = requires { M::stiff; };
template <class M> concept HasPacks = requires { M::packs; };
template <class M> concept PacksAnswers = requires { { M::packs } -> std::convertible_to<bool>; };
template <class M> concept StiffAnswers = requires { { M::stiff } -> std::convertible_to<bool>; };
template <class M> concept FrequencyIsIndex = requires { requires M::forcing_frequency < parameter_count_of<M>; };
template <class M> concept FrequencyIsPositive = FrequencyIsIndex<M> && requires {
    requires M::parameters[M::forcing_frequency].domain == Domain::positive; };
template <class M> concept ShiftIsZero = requires { requires M::symmetry_phase_shift == 0.0; };
template <class M> concept HasVariant = requires { M::variant; };
// clang-format on

template <class Table, class Entry>
inline constexpr bool is_table = false;
template <class Entry, std::size_t n>
inline constexpr bool is_table<std::array<Entry, n>, Entry> = n > 0;

/// A non-empty std::array of entries, as a static constexpr member.
template <const auto& table, class Entry>
inline constexpr bool table_of = is_table<std::remove_cvref_t<decltype(table)>, Entry>;

/// Names as jobs write them: a letter or _, then also digits.
constexpr bool is_name(std::string_view text) {
    if (text.empty() || (text[0] >= '0' && text[0] <= '9')) return false;
    return std::all_of(text.begin(), text.end(), [](char c) {
        return c == '_' || (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
    });
}
/// All are names, no two the same.
template <class Table>
constexpr bool are_names(const Table& table) {
    for (std::size_t i = 0; i < table.size(); ++i) {
        if (!is_name(table[i].name)) return false;
        for (std::size_t j = 0; j < i; ++j)
            if (table[j].name == table[i].name) return false;
    }
    return true;
}
template <class Table>
constexpr bool defaults_in_domain(const Table& parameters) {
    for (const Parameter& p : parameters) {
        if (p.default_value != p.default_value) return false;
        if (p.domain == Domain::positive && !(p.default_value > 0.0)) return false;
        if (p.domain == Domain::nonnegative && !(p.default_value >= 0.0)) return false;
    }
    return true;
}
template <class Table>
constexpr bool have_sizes(const Table& parameters) {
    return std::all_of(parameters.begin(), parameters.end(), [](const Parameter& p) { return p.typical_size > 0.0; });
}
template <class M>
constexpr bool signs_are_one() {
    if constexpr (HasSigns<M>)
        return std::all_of(M::symmetry_signs.begin(), M::symmetry_signs.end(),
                           [](double s) { return s == 1.0 || s == -1.0; });
    return true;
}
template <class M>
constexpr bool variant_is_name() {
    if constexpr (HasVariant<M>) return is_name(M::variant);
    return true;
}
constexpr bool are_different(std::initializer_list<std::string_view> names) {
    for (const auto& name : names)
        if (std::count(names.begin(), names.end(), name) != 1) return false;
    return true;
}

/// rhs can be called with such arguments; its return type is checked separately.
template <class M, class T, class... Extra>
concept Callable = requires(const T& t, const State<T, dimension_of<M>>& x, const Constants<M, T>& c,
                            const Extra&... extra) {
    M::rhs(t, x, c, extra...);
};
template <class M, class T>
concept CallablePlain = (input_count_of<M> == 0 && Callable<M, T>) ||
                        (input_count_of<M> > 0 && Callable<M, T, std::array<T, input_count_of<M>>>);
template <class M, class T>
concept CallableSided = (input_count_of<M> == 0 && Callable<M, T, Side<M>>) ||
                        (input_count_of<M> > 0 && Callable<M, T, Side<M>, std::array<T, input_count_of<M>>>);
template <class M, class T>
concept CallableMap = requires(const State<T, dimension_of<M>>& x, const Constants<M, T>& c) {
    M::map(x, c);
};
template <class M, class T>
concept MapTaking = requires(const State<T, dimension_of<M>>& x, const Constants<M, T>& c) {
    { M::map(x, c) } -> std::same_as<State<T, dimension_of<M>>>;
};
template <class M>
concept SmoothAnswers = requires(const Values<double, parameter_count_of<M>>& p) {
    { M::smooth(p) } -> std::same_as<bool>;
};

}  // namespace detail

}  // namespace orbid::models

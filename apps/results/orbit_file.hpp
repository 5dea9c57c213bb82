#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "apps/results/computed_orbit.hpp"
#include "apps/results/cycle_file.hpp"

namespace orbid::apps {

/// Content of orbits.json: the layout of cycles.json for computed orbits. Of an orbit also `status`, `message` (what
/// was found instead), `residual`, `iterations`, `distance` (from the start), `sensitivities` (shape (n p, f), columns
/// named by the top-level key `parameters`), `frequency` [Hz] and `amplitude` where it was found, `origin` and `hits`
/// of a search; of flows without forcing `times` (of the points), `time_sensitivities` and `trivial_multiplier`; with
/// stability `unstable`, `bifurcation_near`, `directions` (per point, per multiplier, per coordinate [re, im]) and
/// `ln_multiplier_sensitivities` (per multiplier, columns as above). A search adds `search`: starts solved,
/// trajectories captured, periods not settled, index sums.
///
/// @param parameters  names of the f free parameters of the sensitivities.
/// @throws std::invalid_argument when an orbit's shapes do not fit its period, the coordinates and the parameters.
[[nodiscard]] std::string orbits_text(const CycleFileHead& head, const ComputedOrbits& orbits,
                                      const std::vector<std::string>& parameters);

/// The orbits of a stored orbits.json as far as a summary, a picture or a branch needs them: without sensitivities,
/// directions and Jacobians; and its fingerprint.
struct StoredOrbits {
    ComputedOrbits orbits;
    std::string fingerprint;  ///< as text; empty: none
};

/// @return nothing when the text is no such file.
[[nodiscard]] std::optional<StoredOrbits> stored_orbits(std::string_view text);

namespace detail {

/// The value of an enumeration that periodic::name() calls so; nothing when it is the name of none.
/// @param last  the last value of the enumeration.
template <class Enum>
[[nodiscard]] std::optional<Enum> named(std::string_view text, Enum last) {
    for (int k = 0; k <= static_cast<int>(last); ++k)
        if (periodic::name(static_cast<Enum>(k)) == text) return static_cast<Enum>(k);
    return std::nullopt;
}

/// Shape (n, p) of p rows of n numbers, null as nan.
/// @throws nlohmann::json::exception when it is something else.
[[nodiscard]] Eigen::MatrixXd columns_of(const nlohmann::json& rows);
/// A number, or nan for null.
[[nodiscard]] double number_of(const nlohmann::json& value);
/// [[re, im], ...]
[[nodiscard]] std::vector<std::complex<double>> complex_of(const nlohmann::json& pairs);
/// `max`, `min`, `mean`, `half_range` and `rms`, one number per coordinate; undefined ones are null.
[[nodiscard]] nlohmann::ordered_json amplitude_json(const periodic::OrbitAmplitude& amplitude);
/// The key `amplitude` of an orbit or a point of a branch; empty when it has none.
/// @throws nlohmann::json::exception when it is something else.
[[nodiscard]] periodic::OrbitAmplitude amplitude_from(const nlohmann::json& orbit);

}  // namespace detail

}  // namespace orbid::apps

#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/records/series.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

struct ModelGuidedSearchOptions {
    /// How cycles are fitted to the data: periods, method, neighbours, symmetry. With the reading covariance of the
    /// first search (CycleSearch::reading_covariance) it need not be estimated again.
    CycleSearchOptions search;
    models::Sensor sensor;                     ///< how the series was read: its points are readings of the model's
                                               ///< states
    double phase = 0.0;                        ///< [rad] of the section (forced models)
    std::optional<models::Section> section{};  ///< autonomous flows: needed
    /// Known errors of theta (sds of the free parameters). They give the search radius of each orbit: a measured cycle
    /// belongs to an orbit when all its points lie within four sds. Predicted and measured variances are added.
    Eigen::MatrixXd covariance{};        ///< of the free parameters, shape (f, f); empty: theta is exact
    std::vector<Eigen::Index> free{};    ///< indices of the free parameters
    std::size_t maximum_orbits = 400;    ///< of each period: the least unstable, so the most visited
    std::size_t search_points = 100000;  ///< of the model's section, to search for orbits, >= 100
};

struct ModelGuidedSearch {
    /// New cycles, measured in the series, none of them known before. Indices of mirror partners refer to this list.
    std::vector<Cycle> cycles;
    /// Cycle::common of every known cycle that the same map gives again: in the terms of the new ones, which replace
    /// the old ones. Empty entries, or an empty list: nothing is known to be shared with the new cycles.
    std::vector<Eigen::MatrixXd> known_common;
    std::size_t orbits = 0;       ///< of the model at the requested periods, one of every mirror pair
    std::size_t candidates = 0;   ///< of these: orbits to which no known cycle belongs
    std::size_t not_visited = 0;  ///< of the candidates: the series has too few points near them
    std::size_t rejected = 0;     ///< the data do not close, or close elsewhere than the model predicts
    std::size_t known = 0;        ///< the data close on a cycle that is known or belongs to another orbit
    std::vector<std::string> remarks;
};

/// Finds cycles of the series with an improved model that the search from the data alone missed.
///
/// Fits to the data start from the model's orbits of the requested periods (periodic::search_orbits) to which no known
/// cycle belongs. The returned cycles are measured: their points and covariance come from the series, and the model
/// only says where to search. Each cycle, known or new, belongs to at most one orbit, the nearest. An orbit whose fit
/// ends nearer to another one is left out. A wrong model therefore adds few cycles, but hardly any wrong ones.
///
/// Forced models and maps; autonomous flows with a plane. The series may lack a coordinate of the model (the one that a
/// plane fixes): coordinates are matched by name.
///
/// @param theta  shape (q), all parameters.
/// @param known  as find_cycles gave them, mirror partners included.
/// @throws as find_cycles; std::invalid_argument for a covariance that does not fit the free parameters, an autonomous
///         flow without a plane, parameters outside their domain; DataError for a series coordinate that the model does
///         not have, and for a search by closest returns.
[[nodiscard]] ModelGuidedSearch model_guided_search(const Series& series, const models::System& system,
                                                    const Eigen::VectorXd& theta, const std::vector<Cycle>& known,
                                                    const ModelGuidedSearchOptions& options);

}  // namespace orbid::orbits

#pragma GCC visibility pop

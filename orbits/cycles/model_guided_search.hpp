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
    /// How cycles are fitted to the data: periods, method, neighbours, symmetry. The reading covariance that the first
    /// search found (CycleSearch::reading_covariance) spares estimating it again.
    CycleSearchOptions search;
    models::Sensor sensor;                     ///< how the series was read: its points are readings of the model's
                                               ///< states
    double phase = 0.0;                        ///< [rad] of the section (forced models)
    std::optional<models::Section> section{};  ///< autonomous flows: needed
    /// Known errors of theta (sds of the free parameters), from which the search radius of every orbit follows: a
    /// measured cycle belongs to an orbit when all its points lie within four sds, predicted and measured ones added
    /// squared.
    Eigen::MatrixXd covariance{};        ///< of the free parameters, shape (f, f); empty: theta is exact
    std::vector<Eigen::Index> free{};    ///< indices of the free parameters
    std::size_t maximum_orbits = 400;    ///< of each period: those that are least unstable, so most visited
    std::size_t search_points = 100000;  ///< of the model's section, among which its orbits are looked for, >= 100
};

struct ModelGuidedSearch {
    /// New ones, measured in the series; none of them among the known ones. Indices of mirror partners are places in
    /// this list.
    std::vector<Cycle> cycles;
    std::size_t orbits = 0;       ///< of the model, of the periods asked for, one of every mirror pair
    std::size_t candidates = 0;   ///< of these: that no known cycle is the image of
    std::size_t not_visited = 0;  ///< of the candidates: the series has too few points near them
    std::size_t rejected = 0;     ///< the data do not close, or not where the model says
    std::size_t known = 0;        ///< the data close on a cycle that is known or belongs to another orbit
    std::vector<std::string> remarks;
};

/// With an improved model, cycles of the series that the search from the data alone missed.
///
/// The model's orbits of the periods asked for (periodic::search_orbits) that no known cycle belongs to are the starts
/// of fits to the data. What is returned is measured: its points and covariance come from the series, the model only
/// said where to look. A known cycle belongs to one orbit at most, the nearest; so does a new one, and an orbit whose
/// fit ends nearer to another one is left out. So a wrong model adds few cycles, but hardly wrong ones.
///
/// Forced models and maps; autonomous flows with a plane. The series may lack coordinates of the model (the one that a
/// plane fixes): they are matched by name.
///
/// @param theta  shape (q), all parameters.
/// @param known  as find_cycles gave them, mirror partners included.
/// @throws std::invalid_argument as find_cycles; for a series coordinate that the model does not have, a covariance
///         that does not fit the free parameters, an autonomous flow without a plane, parameters outside their domain.
[[nodiscard]] ModelGuidedSearch model_guided_search(const Series& series, const models::System& system,
                                                    const Eigen::VectorXd& theta, const std::vector<Cycle>& known,
                                                    const ModelGuidedSearchOptions& options);

}  // namespace orbid::orbits

#pragma GCC visibility pop

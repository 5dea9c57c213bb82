#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "models/system.hpp"
#include "orbits/cycle_search.hpp"
#include "orbits/series.hpp"

namespace orbid::orbits {

struct HarvestOptions {
    CycleSearchOptions search;  ///< how cycles are fitted to the data: method, neighbours, symmetry, reading covariance
    models::Sensor sensor;      ///< how the series was read: measured points are readings of the model's states
    double phase = 0.0;         ///< [rad] of the section
    /// Known errors of theta (sds of the free parameters), from which the search radius of every orbit follows; the
    /// nearest measured cycle must lie within four of its predicted sds.
    Eigen::MatrixXd covariance;        ///< of the free parameters, shape (f, f)
    std::vector<Eigen::Index> free;    ///< indices of the free parameters
    std::size_t maximum_orbits = 400;  ///< of each period
};

struct Harvest {
    std::vector<Cycle> cycles;    ///< new ones, measured in the series; none of them among the known ones
    std::size_t candidates = 0;   ///< orbits of the model that no known cycle is the image of
    std::size_t not_visited = 0;  ///< of these: the series has too few points near them
    std::size_t rejected = 0;     ///< the data do not close where the model says
    std::vector<std::string> remarks;
};

/// With an improved model, cycles of the series that the search from the data alone missed: the model's orbits of the
/// periods asked for that no known cycle belongs to are the starts of fits to the data. What is returned is measured:
/// its points and covariance come from the series, the model only said where to look.
/// @throws std::invalid_argument as find_cycles; autonomous systems without a plane.
[[nodiscard]] Harvest harvest(const Series& series, const models::System& system, const Eigen::VectorXd& theta,
                              const std::vector<Cycle>& known, const HarvestOptions& options);

}  // namespace orbid::orbits

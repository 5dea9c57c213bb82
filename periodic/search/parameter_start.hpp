#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "models/system/system.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/orbit/solver_options.hpp"

namespace orbid::periodic {

struct CarriedOrbitOptions {
    double phase = 0.0;                      ///< of the section [rad] (forced models)
    std::optional<models::Section> section;  ///< autonomous flows: needed
    double first_step = 0.25;                ///< share of the way tried first, in (0, 1]
    double smallest_step = 1e-3;             ///< share below which an orbit is given up, > 0
    /// A step that moves a point farther than this (relative to the scale) from where it was predicted is halved: it
    /// may have met another orbit. > 0
    double largest_miss = 0.02;
    ShootingOptions solver{};  ///< its maximum_distance is not used
};

/// What became of an orbit on the way to another theta.
struct CarriedOrbit {
    bool arrived = false;
    double share = 0.0;   ///< of the way that it was followed, 1 when it arrived
    PeriodicOrbit orbit;  ///< at theta_new when it arrived, otherwise the last one on the way
    /// How the first step that failed ended, on the last size tried; converged when it arrived. `other_orbit`: only
    /// orbits farther than `largest_miss` were met. Near a fold the share says where.
    OrbitStatus lost = OrbitStatus::converged;
};

/// The orbits of one theta at a neighbouring one, by natural continuation along the straight line between the two: each
/// step starts from the extrapolated points and T of the last two, its size doubles after easy steps and halves after
/// failures. Parallel over orbits; the same with any number of threads.
///
/// Folds end an orbit here (follow_branches() goes around them); an orbit that passes a doubling keeps its period.
/// @param orbits  converged at theta, points as options.phase or options.section say.
/// @throws std::invalid_argument on wrong shapes, a parameter outside its domain at theta_new, options out of range.
[[nodiscard]] std::vector<CarriedOrbit> orbits_at(const models::System& system, const Eigen::VectorXd& theta,
                                                  const Eigen::VectorXd& theta_new,
                                                  std::span<const PeriodicOrbit> orbits,
                                                  const CarriedOrbitOptions& options = {});

}  // namespace orbid::periodic

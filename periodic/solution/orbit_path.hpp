#pragma once

#include <optional>
#include <span>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/orbit/shooting_mesh.hpp"
#include "periodic/orbit/solver_options.hpp"

namespace orbid::periodic {

/// How an orbit is named as a start: by its points at `phase` or on `section`, or by a state and T where an autonomous
/// flow has no section.
struct OrbitPlace {
    double phase = 0.0;                      ///< forced models
    std::optional<models::Section> section;  ///< autonomous flows

    /// An orbit as a start of another one.
    [[nodiscard]] StartingSolution start(const models::System& system, const PeriodicOrbit& orbit) const;
};

struct OrbitPathOptions {
    double maximum_move = 0.1;  ///< of a point from its prediction, relative to the orbit's size; > 0
    int most_halvings = 4;      ///< the line is divided into 2^this steps at most; >= 0
    ShootingOptions solver{};   ///< its distance is set here; an empty scale is orbit_size()
};

/// The size of each coordinate along an orbit: half its range or its root mean square, whichever is larger; never 0.
/// @param phase  of its first point [rad] (forced models)
[[nodiscard]] Eigen::VectorXd orbit_size(const models::System& system, const Eigen::VectorXd& values, double phase,
                                         const PeriodicOrbit& orbit);

/// Follows an orbit while parameters move along a straight line: one Newton's method per step, from the last orbit
/// moved to first order. A line that is too long for one step is divided into 2, 4, 8, ... A fold on the way ends it.
/// @param orbit  solved at `from`, with sensitivities to `free`
/// @param free   the parameters in which `from` and `to` differ
/// @return the orbit at `to` with sensitivities to `free`, or one whose status says why there is none
[[nodiscard]] PeriodicOrbit orbit_along(const models::System& system, const Eigen::VectorXd& from,
                                        const PeriodicOrbit& orbit, const Eigen::VectorXd& to,
                                        std::span<const Eigen::Index> free, const OrbitPlace& place,
                                        const OrbitPathOptions& options = {});

}  // namespace orbid::periodic

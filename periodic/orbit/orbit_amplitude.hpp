#pragma once

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "periodic/orbit/shooting_mesh.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

struct PeriodicOrbit;

/// How far each coordinate moves along an orbit, in its own unit; shape (n) each, empty where it is not known. Angles
/// are continuous along the orbit, with a mean in (-pi, pi]. All are nan for angles that turn around.
struct OrbitAmplitude {
    Eigen::VectorXd maximum;
    Eigen::VectorXd minimum;
    Eigen::VectorXd mean;        ///< over time
    Eigen::VectorXd half_range;  ///< (maximum - minimum) / 2
    Eigen::VectorXd rms;         ///< root of the mean square of the coordinate itself, its mean included
};

/// The amplitude of the orbit through the nodes of a mesh. Means are those of equidistant instants, which converge
/// faster than any power of their distance for smooth orbits: 32 per period, or 512 where half of the 32 give other
/// means. Extrema are located between instants whose slopes have other signs, by the motion itself. Of maps: over the
/// nodes.
/// @return empty vectors if the orbit cannot be simulated.
[[nodiscard]] OrbitAmplitude amplitude_of(const models::System& system, const Eigen::VectorXd& theta,
                                          const ShootingMesh& mesh, const models::FlowOptions& options);

/// The same of a solved orbit, followed from each of its points to the next.
/// @param phase  of its first point [rad] (forced models).
[[nodiscard]] OrbitAmplitude amplitude_of(const models::System& system, const Eigen::VectorXd& theta, double phase,
                                          const PeriodicOrbit& orbit, const models::FlowOptions& options);

}  // namespace orbid::periodic

#pragma GCC visibility pop

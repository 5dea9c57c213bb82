#pragma once

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

/// What fixes the phase of an autonomous orbit where no section is named, see phase_condition().
enum class PhaseChoice {
    automatic,  ///< the plane, and by multiple shooting the integral condition where that ends without an orbit
    plane,      ///< Poincare's condition on the first state
    integral    ///< on all nodes
};

/// Options of Newton's method that all discretisations share.
struct ShootingOptions {
    /// Converged when closing error and Newton step fall below this x scale, or stagnate at rounding level; > 0. That
    /// last step is still taken: the error of the points is its square, down to the error of the flow.
    double tolerance = 1e-9;
    int maximum_iterations = 40;    ///< Newton steps, > 0
    double minimum_damping = 1e-4;  ///< smallest step length tried, in (0, 1)
    /// A converged orbit whose points moved farther than this (relative to `scale`, see below) is `other_orbit`. > 0;
    /// infinity: any.
    double maximum_distance = 0.1;
    /// Typical size of each coordinate (angle: 2 pi); empty: 2 pi for angles, largest |guess| or 1 otherwise.
    Eigen::VectorXd scale{};
    models::FlowOptions flow{};
    /// A segment gets further nodes where the ratio of the largest to the smallest growth of an error exceeds this
    /// (flows); > 1, infinity: none. Sensitivities lose as many digits as this has; multipliers do not, see
    /// FlowSteps::pieces().
    double segment_growth = 1e5;
    /// Where Newton's first step does not contract, the orbit nearest to the guess is sought. false: accept any orbit
    /// that Newton's method finds.
    bool nearest = true;
    PhaseChoice phase = PhaseChoice::automatic;  ///< autonomous flows without a section
};

}  // namespace orbid::periodic

#pragma GCC visibility pop

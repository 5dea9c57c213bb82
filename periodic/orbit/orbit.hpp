#pragma once

#include <complex>
#include <limits>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

/// How the search for a periodic orbit ended.
enum class OrbitStatus {
    converged,
    no_progress,
    iteration_limit,
    not_simulated,
    singular,
    other_orbit,
    shorter_period,
    equilibrium,     ///< autonomous flows: an equilibrium was found
    period_vanished  ///< autonomous flows: the period went to zero
};

[[nodiscard]] std::string_view name(OrbitStatus status);

/// An orbit was found, whichever.
[[nodiscard]] constexpr bool is_orbit(OrbitStatus status) {
    return status == OrbitStatus::converged || status == OrbitStatus::other_orbit ||
           status == OrbitStatus::shorter_period;
}

/// A periodic orbit. Forced model or map: one node per period. Autonomous flow: its crossings of a section, or the
/// nodes of its discretisation where no section was named.
///
///     x_{j+1} = Phi(x_j; theta), j mod p, with x_p = x_0 + 2 pi r in the angle coordinates
struct PeriodicOrbit {
    OrbitStatus status = OrbitStatus::no_progress;
    int period = 0;             ///< p, in periods of the forcing; autonomous: crossings of the section, 1 without one
    std::vector<int> rotation;  ///< turns per orbit, one per angle coordinate
    Eigen::MatrixXd points;     ///< shape (n, p), angles in (-pi, pi]; p: nodes without a section
    std::vector<Eigen::MatrixXd> jacobians;         ///< X_j = dPhi/dx from point j to the next, shape (n, n) each
    std::vector<std::complex<double>> multipliers;  ///< Floquet multipliers, largest modulus first, the trivial one not
    /// shorter_period: how many times the requested orbit runs through the one found, whose period, time and rotation
    /// are that many times less; 1 otherwise.
    int repeats = 1;
    double residual = 0.0;  ///< largest closing error max_j |Phi(x_j) - x_{j+1}| over coordinates
    int iterations = 0;
    double distance = 0.0;  ///< largest move of a point from its guess, relative to the scales given
    bool sticking = false;  ///< a period contains sticking: multipliers carry an exact zero
    /// d points / d theta for the free parameters asked for: shape (n p, f), in the order of points; empty otherwise.
    Eigen::MatrixXd sensitivities;
    double time = 0.0;                      ///< T, duration of the orbit [s]; iterations of a map
    Eigen::VectorXd times;                  ///< shape of the points: time of each since the first [s]
    Eigen::RowVectorXd time_sensitivities;  ///< dT / d theta, shape (f) [s per unit]; empty unless autonomous
    /// Autonomous: the multiplier of a shift along the orbit, 1 but for rounding and discretisation; nan otherwise.
    std::complex<double> trivial_multiplier = std::numeric_limits<double>::quiet_NaN();
    /// Estimated discretisation error of the points, relative to the scales; 0 where the flow is followed to its own
    /// accuracy (shooting).
    double discretisation_error = 0.0;
};

}  // namespace orbid::periodic

#pragma GCC visibility pop

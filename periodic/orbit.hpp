#pragma once

#include <complex>
#include <string_view>
#include <vector>

#include <Eigen/Core>

namespace orbid::periodic {

/// How the search for a periodic orbit ended.
enum class OrbitStatus {
    converged,
    no_progress,
    iteration_limit,
    not_simulated,
    singular,
    other_orbit,
    shorter_period
};

[[nodiscard]] std::string_view name(OrbitStatus status);

/// A periodic orbit of a forced model (or map) at one node per period.
///
///     x_{j+1} = Phi(x_j; theta), j mod p, with x_p = x_0 + 2 pi r in the angle coordinates
struct PeriodicOrbit {
    OrbitStatus status = OrbitStatus::no_progress;
    int period = 0;                                 ///< p, in periods of the forcing
    std::vector<int> rotation;                      ///< turns per orbit, one per angle coordinate
    Eigen::MatrixXd points;                         ///< shape (n, p), angles in (-pi, pi]
    std::vector<Eigen::MatrixXd> jacobians;         ///< X_j = dPhi/dx at point j, shape (n, n) each
    std::vector<std::complex<double>> multipliers;  ///< Floquet multipliers, largest modulus first
    double residual = 0.0;  ///< largest closing error max_j |Phi(x_j) - x_{j+1}| over coordinates
    int iterations = 0;
    double distance = 0.0;  ///< largest move of a point from its guess, relative to the scales given
    bool sticking = false;  ///< a period contains sticking: multipliers carry an exact zero
    /// d points / d theta for the free parameters asked for: shape (n p, f), in the order of points; empty otherwise.
    Eigen::MatrixXd sensitivities;
};

}  // namespace orbid::periodic

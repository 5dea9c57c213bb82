#pragma once

#include <complex>
#include <span>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "periodic/orbit/orbit.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

/// What happens to an orbit when a multiplier crosses the unit circle.
enum class Bifurcation {
    none,             ///< every multiplier is farther than `near` from the unit circle
    fold,             ///< at +1: the orbit meets another one and both vanish (or branches cross, by symmetry)
    period_doubling,  ///< at -1
    neimark_sacker,   ///< a complex pair
    branch_point      ///< at +1: branches cross, as where a symmetry breaks; only along a branch distinct from a fold
};

[[nodiscard]] std::string_view name(Bifurcation bifurcation);

struct StabilityOptions {
    double near = 0.05;  ///< | |multiplier| - 1 | below which a bifurcation is called near; > 0
    models::FlowOptions flow{};
};

/// How an orbit attracts and repels, and how that changes with the parameters. Entry m belongs to orbit.multipliers[m].
struct Stability {
    bool simulated = false;  ///< everything below `nearest` is meaningful only if so
    int unstable = 0;        ///< number of multipliers outside the unit circle
    Bifurcation nearest = Bifurcation::none;
    double distance = 0.0;  ///< smallest | |multiplier| - 1 |; infinity without multipliers
    /// Eigenvectors of the monodromy matrix at each point, unit norm: directions[j].col(m), shape (n, number of
    /// multipliers). A complex pair has conjugate ones. nan where a multiplier is zero (sticking).
    std::vector<Eigen::MatrixXcd> directions;
    /// d ln|multiplier_m| / d theta, with the orbit moving along, shape (number of multipliers, f). nan where a
    /// multiplier is zero, or not simple (1e-8 relative).
    Eigen::MatrixXd ln_multiplier_sensitivities;
};

/// Type of the nearby bifurcation, by the distance of the multipliers from the unit circle alone.
[[nodiscard]] Bifurcation nearest_bifurcation(const std::vector<std::complex<double>>& multipliers, double near);

/// Directions by inverse iteration on the cyclic system, so that the weak ones keep their digits beside the strong
/// ones. Derivatives from left and right eigenvectors and second derivatives of the flow,
///
///     d ln mu = sum_j w_{j+1}^H dX_j v_j / (w_{j+1}^H X_j v_j),
///     dX_j = X_j,theta + X_j,x dx_j/dtheta + X_j,t dt_j/dtheta.
///
/// @param orbit  converged, with points on the model's own orbit (multiple shooting, or equally accurate) and
/// sensitivities for the parameters `free` (in that order).
/// @param phase  of the section [rad] (forced models).
/// @throws std::invalid_argument on an orbit that is not converged or lacks sensitivities, or near <= 0.
/// @throws std::logic_error when the system offers no second derivatives and `free` is not empty.
[[nodiscard]] Stability stability(const models::System& system, const Eigen::VectorXd& theta, double phase,
                                  const PeriodicOrbit& orbit, std::span<const Eigen::Index> free,
                                  const StabilityOptions& options = {});

}  // namespace orbid::periodic

#pragma GCC visibility pop

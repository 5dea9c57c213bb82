#include "estimator/sampling/hamiltonian.hpp"

#include <cmath>

#include "estimator/interface/not_finite.hpp"

namespace orbid::estimator {

void evaluate(const NegativeLogDensity& density, PhasePoint& point) {
    point.gradient.resize(point.x.size());
    point.potential = density(point.x, &point.gradient);
    // A density that cannot be differentiated there cannot be followed either.
    if (!std::isfinite(point.potential) || !point.gradient.allFinite()) point.potential = infinity;
}

void leapfrog(const NegativeLogDensity& density, const Eigen::MatrixXd& factor, double step, PhasePoint& point) {
    const auto kick = [&] { point.r.noalias() -= (0.5 * step) * (factor.transpose() * point.gradient); };
    kick();
    point.x.noalias() += step * (factor * point.r);
    evaluate(density, point);
    if (std::isfinite(point.potential)) kick();
}

}  // namespace orbid::estimator

#include "estimator/uncertainty/error_interval.hpp"

#include <algorithm>
#include <cmath>

#include "estimator/interface/not_finite.hpp"
#include "estimator/uncertainty/normality.hpp"

namespace orbid::estimator {

namespace {

/// Of the root at an end: a two-thousandth of the interval's half width.
constexpr double close_enough = 1e-3;
constexpr int most_steps = 30;

}  // namespace

std::pair<double, double> error_interval(ErrorProblem problem, const Eigen::VectorXd& psi, Eigen::Index k, double sd,
                                         const Eigen::VectorXd& floor, const Eigen::VectorXd& ceiling) {
    problem.free[static_cast<std::size_t>(k)] = false;
    const auto least = [&](double value) {
        Eigen::VectorXd start = psi;
        start[k] = value;
        return minimise_errors(problem, start, floor, ceiling, {1e-5}).after;
    };
    const double centre = least(psi[k]);
    const auto end = [&](double sign) {
        const double limit = sign < 0.0 ? floor[k] : ceiling[k];
        double near = psi[k], below = -normal_975, far = nan_value, above = nan_value;
        double next = near + sign * normal_975 * sd;
        for (int step = 0; step < most_steps; ++step) {
            const double value = sign < 0.0 ? std::max(next, limit) : std::min(next, limit);
            const double excess = std::sqrt(2.0 * std::max(0.0, least(value) - centre)) - normal_975;
            if (std::isnan(excess) || std::abs(excess) < close_enough) return std::isnan(excess) ? nan_value : value;
            if (excess < 0.0 && value == limit) return limit;
            (excess < 0.0 ? near : far) = value;
            (excess < 0.0 ? below : above) = excess;
            // The root is nearly a straight line: its zero, kept away from both ends of a bracket.
            if (std::isnan(far))
                next = near + (near - psi[k]) * std::clamp(-1.1 * below / (normal_975 + below), 0.1, 1.0);
            else
                next = near + (far - near) * std::clamp(-below / (above - below), 0.05, 0.95);
        }
        return nan_value;
    };
    return {end(-1.0), end(1.0)};
}

}  // namespace orbid::estimator

#include <algorithm>
#include <cmath>

#include "orbits/cycles/cycle_refinement.hpp"
#include "orbits/local_maps/local_map.hpp"
#include "periodic/discretisation/cyclic_system.hpp"

namespace orbid::orbits {
namespace {

// Step of differences of a local map's jacobian, in its radius: their error is of the order of 1e-6 of the curvature,
// far below what a covariance needs.
constexpr double radius_difference_step = 1e-3;

// d vec(jacobian) / d place of a local map at its centre, shape (n n, n).
Eigen::MatrixXd curvature(const LocalMap& map) {
    const Eigen::Index n = map.jacobian.rows();
    Eigen::MatrixXd result = Eigen::MatrixXd::Zero(n * n, n);
    const double step = radius_difference_step * map.radius;
    for (Eigen::Index d = 0; d < n; ++d) {
        const Eigen::VectorXd h = step * Eigen::VectorXd::Unit(n, d);
        const Eigen::MatrixXd change = (map.jacobian_at(h) - map.jacobian_at(-h)) / (2.0 * step);
        result.col(d) = Eigen::Map<const Eigen::VectorXd>(change.data(), n * n);
    }
    return result;
}

// Squared distance of the values of other fits of a point from its map's, over what their predicted errors allow; at
// least 1. The other fits are worse by orders of magnitude on clean data, so that the distance itself says little.
double disagreement(const SectionPoints& section, const PlacedFits& placed) {
    const LocalMap& own = placed.fits.front();
    double sum = 0.0;
    int count = 0;
    for (std::size_t other = 1; other < placed.fits.size(); ++other) {
        const LocalMap& fit = placed.fits[other];
        if (!fit.usable) continue;
        const double predicted = own.value_sd * own.value_sd + fit.value_sd * fit.value_sd;
        const double found =
            section.difference(fit.value, own.value).squaredNorm() / static_cast<double>(own.value.size());
        sum += predicted > 0.0 ? found / predicted : 1.0;
        ++count;
    }
    return count > 0 ? std::max(1.0, sum / count) : 1.0;
}

}  // namespace

CycleUncertainty cycle_uncertainty(const SectionPoints& section, const RefinedCycle& cycle,
                                   const std::vector<PlacedFits>& fits, const std::vector<RefinedCycle>& refits) {
    const Eigen::Index n = cycle.points.rows(), p = cycle.points.cols();
    const std::vector<Eigen::MatrixXd> jacobians = cycle.jacobians(section);
    CycleUncertainty result;
    result.multipliers = cycle_multipliers(jacobians);

    const Eigen::MatrixXd inverse =  // points from values
        periodic::CyclicSystem(jacobians).solve(Eigen::MatrixXd::Identity(n * p, n * p));
    const Eigen::MatrixXd derivative = ln_multiplier_derivative(jacobians);

    // ln|multipliers| move with the jacobians directly and, through the curvature, with the points.
    Eigen::MatrixXd by_points(n, n * p);
    for (Eigen::Index j = 0; j < p; ++j)
        by_points.middleCols(j * n, n) =
            derivative.middleCols(j * n * n, n * n) * curvature(fits[static_cast<std::size_t>(j)].fits.front());
    const Eigen::MatrixXd by_values = by_points * inverse;

    result.covariance = Eigen::MatrixXd::Zero(n * p, n * p);
    result.ln_multiplier_covariance = Eigen::MatrixXd::Zero(n, n);
    for (Eigen::Index j = 0; j < p; ++j) {
        const auto at = static_cast<std::size_t>(j);
        const double apart = disagreement(section, fits[at]);
        result.disagreement = std::max(result.disagreement, std::sqrt(apart));
        const Eigen::MatrixXd errors = apart * local_map_covariance(fits[at].neighbours, fits[at].fits.front(),
                                                                    cycle.sizes[at].front().neighbours);
        Eigen::MatrixXd to_points = Eigen::MatrixXd::Zero(n * p, errors.rows());
        to_points.leftCols(n) = inverse.middleCols(j * n, n);
        Eigen::MatrixXd to_multipliers(n, errors.rows());
        to_multipliers.leftCols(n) = by_values.middleCols(j * n, n);
        to_multipliers.rightCols(n * n) = derivative.middleCols(j * n * n, n * n);
        result.covariance += to_points * errors * to_points.transpose();
        result.ln_multiplier_covariance += to_multipliers * errors * to_multipliers.transpose();
    }

    // Sizes were chosen for the values; what the jacobians depend on them is seen in the cycles on other fits.
    for (const RefinedCycle& refit : refits) {
        const Eigen::VectorXd change =
            cycle_multipliers(refit.jacobians(section)).ln_modulus - result.multipliers.ln_modulus;
        if (change.allFinite())
            result.ln_multiplier_covariance += change * change.transpose() / static_cast<double>(refits.size());
    }

    result.covariance = floored_covariance(result.covariance);
    result.ln_multiplier_covariance = floored_covariance(result.ln_multiplier_covariance);
    return result;
}

}  // namespace orbid::orbits

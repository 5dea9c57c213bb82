#include "estimator/sampling/sandwich_map.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "models/arithmetic/eigenvalues.hpp"

namespace orbid::estimator {

namespace {

/// The power +-1/2 of a covariance matrix. Equilibrated before: parameters have units of their own.
Eigen::MatrixXd root(const Eigen::MatrixXd& covariance, double power) {
    const models::SymmetricEigen eigen = models::symmetric_eigen(covariance);
    const double least = 1e-12 * eigen.values.maxCoeff();
    const Eigen::VectorXd values =
        eigen.values.unaryExpr([&](double value) { return std::pow(std::max(value, least), power); });
    return eigen.vectors * values.asDiagonal() * eigen.vectors.transpose();
}

}  // namespace

SandwichMap::SandwichMap(const Problem& problem, const Estimate& estimate, const Eigen::MatrixXd& laplace)
    : lower_(problem.lower), upper_(problem.upper) {
    const auto q = static_cast<Eigen::Index>(problem.parameters.size());
    centre_.resize(q);
    Eigen::VectorXd slope(q);
    std::vector<Eigen::Index> moved;
    bool differs = false;
    for (Eigen::Index i = 0; i < q; ++i) {
        const Estimated& parameter = estimate.parameters[static_cast<std::size_t>(i)];
        const Coordinate& coordinate = problem.coordinates[static_cast<std::size_t>(i)];
        centre_[i] = coordinate.at(parameter.value);
        slope[i] = coordinate.slope(parameter.value);
        if (parameter.sd > 0.0) moved.push_back(i);
        differs = differs || (parameter.sd > 0.0 && parameter.sd != parameter.laplace_sd);
    }
    if (!differs || laplace.size() == 0) return;
    // Units of one sd of the table each.
    const auto count = static_cast<Eigen::Index>(moved.size());
    Eigen::VectorXd unit(count);
    for (Eigen::Index i = 0; i < count; ++i) {
        const Eigen::Index k = moved[static_cast<std::size_t>(i)];
        unit[i] = estimate.parameters[static_cast<std::size_t>(k)].sd / slope[k];
    }
    const Eigen::MatrixXd by_unit = unit.cwiseInverse().asDiagonal();
    const Eigen::MatrixXd correlation = estimate.correlation(moved, moved);
    const Eigen::MatrixXd independent = by_unit * laplace(moved, moved) * by_unit;
    const Eigen::MatrixXd own = root(correlation, 0.5) * root(independent, -0.5);
    map_ = Eigen::MatrixXd::Identity(q, q);
    map_(moved, moved) = unit.asDiagonal() * own * by_unit;
}

Eigen::VectorXd SandwichMap::operator()(const Eigen::VectorXd& u) const {
    if (!moves()) return u;
    return (centre_ + map_ * (u - centre_)).cwiseMax(lower_).cwiseMin(upper_);
}

}  // namespace orbid::estimator

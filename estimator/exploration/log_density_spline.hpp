#pragma once

#include <functional>
#include <vector>

#include <Eigen/Core>

namespace orbid::estimator {

/// A density of one number, given by its logarithm at some points: cubic spline between them, zero beyond.
///
/// A spline of the logarithm never becomes negative and is exact for a normal density. Its error is O(h^4) (twice
/// differentiable, with the third derivative continuous at the points next to the ends: "not a knot").
class LogDensitySpline {
public:
    /// @param u            ascending, two or more.
    /// @param log_density  up to a constant, finite; shape of u.
    /// @throws std::invalid_argument when that does not hold.
    LogDensitySpline(std::vector<double> u, std::vector<double> log_density);

    [[nodiscard]] double log_density(double u) const;  ///< normalised; -infinity beyond the ends
    /// u with that cumulative probability. @throws std::invalid_argument unless 0 <= p <= 1.
    [[nodiscard]] double quantile(double p) const;
    /// Mean of a function over the density, by Gauss's rule with ten points per interval.
    [[nodiscard]] double expectation(const std::function<double(double u)>& function) const;
    /// ln of the integral of the density as given.
    [[nodiscard]] double log_normalisation() const { return log_normalisation_; }

private:
    [[nodiscard]] double spline(std::size_t interval, double u) const;
    [[nodiscard]] double mass(std::size_t interval, double from, double to) const;

    std::vector<double> u_;
    std::vector<double> value_;
    Eigen::VectorXd second_;       ///< second derivatives at the points
    std::vector<double> running_;  ///< probability up to each point
    double log_normalisation_ = 0.0;
};

}  // namespace orbid::estimator

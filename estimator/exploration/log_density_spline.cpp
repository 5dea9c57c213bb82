#include "estimator/exploration/log_density_spline.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include <boost/math/quadrature/gauss.hpp>

#include "models/arithmetic/lu_factor.hpp"

namespace orbid::estimator {

namespace {

using Rule = boost::math::quadrature::gauss<double, 10>;

/// Second derivatives of the not-a-knot spline; of the parabola through three points, zero through two.
Eigen::VectorXd second_derivatives(const std::vector<double>& points, const std::vector<double>& values) {
    const auto n = static_cast<Eigen::Index>(points.size());
    if (n < 3) return Eigen::VectorXd::Zero(n);
    const Eigen::Map<const Eigen::VectorXd> u(points.data(), n);
    const Eigen::Map<const Eigen::VectorXd> value(values.data(), n);
    const auto h = [&](Eigen::Index i) { return u[i + 1] - u[i]; };
    const auto slope = [&](Eigen::Index i) { return (value[i + 1] - value[i]) / h(i); };
    if (n == 3) return Eigen::VectorXd::Constant(3, 2.0 * (slope(1) - slope(0)) / (h(0) + h(1)));
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd b = Eigen::VectorXd::Zero(n);
    for (Eigen::Index i = 1; i + 1 < n; ++i) {
        a(i, i - 1) = h(i - 1);
        a(i, i) = 2.0 * (h(i - 1) + h(i));
        a(i, i + 1) = h(i);
        b[i] = 6.0 * (slope(i) - slope(i - 1));
    }
    a(0, 0) = h(1);
    a(0, 1) = -(h(0) + h(1));
    a(0, 2) = h(0);
    a(n - 1, n - 3) = h(n - 2);
    a(n - 1, n - 2) = -(h(n - 3) + h(n - 2));
    a(n - 1, n - 1) = h(n - 3);
    return models::LuFactor(a).solve(b);
}

}  // namespace

LogDensitySpline::LogDensitySpline(std::vector<double> u, std::vector<double> log_density)
    : u_(std::move(u)), value_(std::move(log_density)) {
    if (u_.size() < 2 || u_.size() != value_.size())
        throw std::invalid_argument("log density: " + std::to_string(u_.size()) + " points with " +
                                    std::to_string(value_.size()) + " values, two or more of each are needed");
    for (std::size_t i = 0; i < u_.size(); ++i)
        if (!std::isfinite(u_[i]) || !std::isfinite(value_[i]) || (i > 0 && !(u_[i] > u_[i - 1])))
            throw std::invalid_argument("log density: points must be finite and ascend");
    const double highest = *std::max_element(value_.begin(), value_.end());
    for (double& value : value_)
        value -= highest;
    second_ = second_derivatives(u_, value_);
    running_.assign(u_.size(), 0.0);
    for (std::size_t i = 0; i + 1 < u_.size(); ++i)
        running_[i + 1] = running_[i] + mass(i, u_[i], u_[i + 1]);
    const double total = running_.back();
    for (double& probability : running_)
        probability /= total;
    for (double& value : value_)
        value -= std::log(total);
    log_normalisation_ = highest + std::log(total);
}

double LogDensitySpline::spline(std::size_t interval, double u) const {
    const double h = u_[interval + 1] - u_[interval];
    const double b = (u - u_[interval]) / h;
    const double a = 1.0 - b;
    const auto k = static_cast<Eigen::Index>(interval);
    return a * value_[interval] + b * value_[interval + 1] +
           ((a * a * a - a) * second_[k] + (b * b * b - b) * second_[k + 1]) * h * h / 6.0;
}

double LogDensitySpline::mass(std::size_t interval, double from, double to) const {
    if (!(to > from)) return 0.0;
    return Rule::integrate([&](double u) { return std::exp(spline(interval, u)); }, from, to);
}

double LogDensitySpline::log_density(double u) const {
    if (!(u >= u_.front()) || !(u <= u_.back())) return -std::numeric_limits<double>::infinity();
    const auto above = std::upper_bound(u_.begin(), u_.end(), u);
    const auto index = static_cast<std::size_t>(above - u_.begin());
    return spline(std::clamp<std::size_t>(index, 1, u_.size() - 1) - 1, u);
}

double LogDensitySpline::quantile(double p) const {
    if (!(p >= 0.0) || !(p <= 1.0))
        throw std::invalid_argument("p = " + std::to_string(p) + " must lie between 0 and 1");
    const auto above = std::upper_bound(running_.begin(), running_.end(), p);
    if (above == running_.begin()) return u_.front();
    if (above == running_.end()) return u_.back();
    const auto i = static_cast<std::size_t>(above - running_.begin()) - 1;
    // Newton kept inside its bracket: the cumulative is smooth and increasing.
    double lower = u_[i];
    double upper = u_[i + 1];
    double u = 0.5 * (lower + upper);
    for (int iteration = 0; iteration < 100; ++iteration) {
        const double excess = running_[i] + mass(i, u_[i], u) - p;
        (excess > 0.0 ? upper : lower) = u;
        double next = u - excess / std::exp(spline(i, u));
        if (!(next > lower) || !(next < upper)) next = 0.5 * (lower + upper);
        if (std::abs(next - u) <= 1e-14 * (std::abs(u) + (u_[i + 1] - u_[i]))) return next;
        u = next;
    }
    return u;
}

double LogDensitySpline::expectation(const std::function<double(double u)>& function) const {
    double sum = 0.0;
    for (std::size_t i = 0; i + 1 < u_.size(); ++i)
        sum += Rule::integrate([&](double u) { return function(u) * std::exp(spline(i, u)); }, u_[i], u_[i + 1]);
    return sum;
}

}  // namespace orbid::estimator

#include "estimator/uncertainty/bounded_interval.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>

#include "estimator/interface/not_finite.hpp"
#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::estimator {

namespace {

/// A standardised density by its upper tail: normal, or Student's t.
class Tail {
public:
    /// @param quantile  of 97.5 %
    explicit Tail(double quantile) {
        // Beyond this many degrees of freedom t is normal to five digits of the quantile.
        constexpr double most = 1e5;
        const auto at = [](double inverse) {
            return boost::math::quantile(boost::math::students_t(1.0 / inverse), 0.975);
        };
        double few = 1.0;  // the quantile rises with 1 / nu; at 1 / nu = 2 it is 39
        double many = 1.0 / most;
        if (!(quantile > at(many))) return;
        while (few < 8.0 && at(few) < quantile)
            few *= 2.0;
        for (int i = 0; i < 60; ++i) {
            const double middle = std::sqrt(few * many);
            (at(middle) < quantile ? many : few) = middle;
        }
        degrees_ = 1.0 / few;
    }

    [[nodiscard]] double above(double x) const {
        if (x == infinity) return 0.0;
        if (x == -infinity) return 1.0;
        return normal() ? boost::math::cdf(boost::math::complement(boost::math::normal(), x))
                        : boost::math::cdf(boost::math::complement(boost::math::students_t(degrees_), x));
    }
    [[nodiscard]] double with_above(double p) const {
        return normal() ? boost::math::quantile(boost::math::complement(boost::math::normal(), p))
                        : boost::math::quantile(boost::math::complement(boost::math::students_t(degrees_), p));
    }
    [[nodiscard]] bool normal() const { return !(degrees_ < infinity); }
    /// Far out, the place beyond which a twentieth lies of what lies beyond x: the tails are like exp(-x^2 / 2) and
    /// (1 + x^2 / nu)^(-nu / 2).
    [[nodiscard]] double twentieth_beyond(double x) const {
        if (normal()) return x + std::log(20.0) / x;
        const double share = degrees_ / x / x;
        return x * std::sqrt((1.0 + share) * std::pow(20.0, 2.0 / degrees_) - share);
    }

private:
    double degrees_ = infinity;
};

/// b with P(x < b | bottom < x < top) = 0.95.
double upper_limit(const Tail& tail, double bottom, double top) {
    // Where the tail would underflow.
    constexpr double least = 1e-190;
    if (bottom > 1.0 && tail.above(bottom) < least) return std::min(tail.twentieth_beyond(bottom), top);
    const double p = 0.05 * tail.above(bottom) + 0.95 * tail.above(top);
    return std::clamp(tail.with_above(p), bottom, top);
}

}  // namespace

BoundedInterval bounded_interval(double mode, double sd, double quantile, double lower, double upper) {
    BoundedInterval result{mode - quantile * sd, mode + quantile * sd, BoundSide::none};
    if (!(sd > 0.0) || !std::isfinite(result.lower) || !std::isfinite(result.upper))
        return {nan_value, nan_value, BoundSide::none};
    const bool below = result.lower < lower;
    const bool above = result.upper > upper;
    if (below && above) return {lower, upper, BoundSide::none};
    if (!below && !above) return result;
    const Tail tail(quantile);
    const double bottom = (lower - mode) / sd;
    const double top = (upper - mode) / sd;
    if (below) return {lower, std::min(mode + sd * upper_limit(tail, bottom, top), upper), BoundSide::upper};
    return {std::max(mode - sd * upper_limit(tail, -top, -bottom), lower), upper, BoundSide::lower};
}

ReleasedParameter released(const Eigen::MatrixXd& curvature, const Eigen::VectorXd& gradient,
                           std::vector<Eigen::Index> free, Eigen::Index parameter) {
    const ReleasedParameter unknown{nan_value, nan_value};
    free.push_back(parameter);
    const Eigen::MatrixXd own = curvature(free, free);
    if (!(own.diagonal().minCoeff() > 0.0)) return unknown;
    const Eigen::VectorXd unit = own.diagonal().cwiseSqrt().cwiseInverse();
    const models::LdltFactor factor(unit.asDiagonal() * own * unit.asDiagonal());
    // A pivot is the share of a parameter's information that the others leave: below this it is rounding.
    constexpr double least_share = 1e-12;
    if (!factor.succeeded() || !(factor.pivots().minCoeff() > least_share)) return unknown;
    const Eigen::Index last = own.cols() - 1;
    const Eigen::VectorXd row = factor.solve(Eigen::VectorXd(Eigen::VectorXd::Unit(own.cols(), last)));
    const double variance = row[last] * unit[last] * unit[last];
    return {-variance * gradient[parameter], std::sqrt(variance)};
}

}  // namespace orbid::estimator

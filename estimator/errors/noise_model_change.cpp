#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <boost/math/quadrature/gauss_kronrod.hpp>

#include "estimator/errors/error_density.hpp"
#include "estimator/errors/noise_model.hpp"

namespace orbid::estimator {

namespace {

/// Errors in units of the law's sd, for the laws whose value is half a sum of squares in them.
Eigen::VectorXd whitened(const NoiseModel& law, const Eigen::VectorXd& e, const Eigen::VectorXd& psi) {
    if (law.joint()) {
        const auto m = static_cast<Eigen::Index>(law.channels.size());
        return detail::uncoupled<double>(e, detail::covariance_triangle<double>(psi, m));
    }
    if (std::holds_alternative<AutoregressiveErrors>(law.distribution)) return detail::decorrelated<double>(e, psi);
    return e * std::exp(-psi[0]);
}

double student_change(const Eigen::VectorXd& e, const Eigen::VectorXd& next, const Eigen::VectorXd& psi) {
    const double nu = std::exp(psi[1]);
    const double spread = nu * std::exp(2.0 * psi[0]);
    double sum = 0.0;
    for (Eigen::Index i = 0; i < e.size(); ++i)
        sum += std::log1p((next[i] - e[i]) * (next[i] + e[i]) / (spread + e[i] * e[i]));
    return 0.5 * (nu + 1.0) * sum;
}

double laplace_change(const Eigen::VectorXd& e, const Eigen::VectorXd& next, double ln_scale) {
    const double s = std::exp(ln_scale);
    const double d = detail::laplace_rounding * s;
    double sum = 0.0;
    for (Eigen::Index i = 0; i < e.size(); ++i)
        sum += (next[i] - e[i]) * (next[i] + e[i]) / (std::hypot(next[i], d) + std::hypot(e[i], d));
    return sum / s;
}

/// [ln(V1 / V0) + e1^2 / V1 - e0^2 / V0] / 2, with V1 - V0 from the change of the prediction y - e.
double relative_change(const Eigen::VectorXd& e, const Eigen::VectorXd& next, const Eigen::VectorXd& observed,
                       const Eigen::VectorXd& psi) {
    assert(observed.size() == e.size());
    const double variance = std::exp(2.0 * psi[0]);
    const double factor = std::exp(2.0 * psi[1]);
    double sum = 0.0;
    for (Eigen::Index i = 0; i < e.size(); ++i) {
        const double before = observed[i] - e[i];
        const double after = observed[i] - next[i];
        const double v = variance + factor * before * before;
        const double v_next = variance + factor * after * after;
        const double v_change = factor * (e[i] - next[i]) * (after + before);
        sum += std::log1p(v_change / v) + ((next[i] - e[i]) * (next[i] + e[i]) - e[i] * e[i] * (v_change / v)) / v_next;
    }
    return 0.5 * sum;
}

/// Probability of an error above e >= 0 under the hyperbolic density, s = 1. With e = d sinh t0, p = exp(-t),
///     int_t0^inf exp(-d cosh t) cosh t dt = exp(-d cosh t0)/d + int_0^exp(-t0) exp(-d (p + 1/p)/2) dp:
/// Laplace's tail and a correction of about a hundredth.
double laplace_tail(double e) {
    constexpr double d = detail::laplace_rounding;
    const double r = std::hypot(e, d);
    const double end = d / (e + r);
    const auto shape = [end](double p) {
        return p > 0.0 ? std::exp(-0.5 * d * (p - end) * (1.0 - 1.0 / (p * end))) : 0.0;
    };
    // Relative to exp(-r), so that the far tail keeps its digits. 1e-9 of the correction is 1e-11 of the tail.
    const double correction = boost::math::quadrature::gauss_kronrod<double, 31>::integrate(shape, 0.0, end, 8, 1e-9);
    return std::exp(-r - detail::laplace_normalisation) * (1.0 + d * correction);
}

/// The standard normal number with this probability beyond it, with the sign of e. A probability below the least
/// double (37.5 sd) counts as that.
double normal_score(double tail, double e) {
    const double beyond = std::clamp(tail, std::numeric_limits<double>::min(), 0.5);
    const double score = boost::math::quantile(boost::math::complement(boost::math::normal(), beyond));
    return std::copysign(score, e);
}

}  // namespace

Eigen::MatrixXd covariance_root(const NoiseModel& law, const Eigen::VectorXd& psi) {
    return detail::covariance_triangle<double>(law.own(psi), static_cast<Eigen::Index>(law.channels.size()));
}

Eigen::VectorXd root_coordinates(const Eigen::MatrixXd& lower) {
    const Eigen::Index m = lower.rows();
    Eigen::VectorXd psi(m * (m + 1) / 2);
    Eigen::Index k = 0;
    for (Eigen::Index j = 0; j < m; ++j)
        for (Eigen::Index i = j; i < m; ++i, ++k)
            psi[k] = i == j ? std::log(lower(i, j)) : lower(i, j);
    return psi;
}

Eigen::MatrixXd covariance_slopes(const NoiseModel& law, const Eigen::VectorXd& psi) {
    const Eigen::MatrixXd lower = covariance_root(law, psi);
    const Eigen::Index m = lower.rows();
    Eigen::MatrixXd slopes(m * m, m * (m + 1) / 2);
    Eigen::Index k = 0;
    for (Eigen::Index j = 0; j < m; ++j)
        for (Eigen::Index i = j; i < m; ++i, ++k) {
            Eigen::MatrixXd change = Eigen::MatrixXd::Zero(m, m);
            change(i, j) = i == j ? lower(i, j) : 1.0;
            const Eigen::MatrixXd half = change * lower.transpose();
            slopes.col(k) = (half + half.transpose()).reshaped();
        }
    return slopes;
}

double value_change(const NoiseModel& law, const Eigen::VectorXd& e, const Eigen::VectorXd& next,
                    const Eigen::VectorXd& observed, const Eigen::VectorXd& psi) {
    assert(e.size() == next.size());
    if (std::holds_alternative<StudentErrors>(law.distribution)) return student_change(e, next, psi);
    if (std::holds_alternative<LaplaceErrors>(law.distribution)) return laplace_change(e, next, psi[0]);
    if (std::holds_alternative<RelativeErrors>(law.distribution)) return relative_change(e, next, observed, psi);
    // (|w1|^2 - |w0|^2) / 2 as a product of difference and sum; whitening is linear.
    const Eigen::VectorXd difference = whitened(law, next - e, psi);
    const Eigen::VectorXd sum = whitened(law, next + e, psi);
    return 0.5 * difference.dot(sum);
}

Eigen::VectorXd standard_errors(const NoiseModel& law, const Eigen::VectorXd& e, const Eigen::VectorXd& observed,
                                const Eigen::VectorXd& psi) {
    Eigen::VectorXd result(e.size());
    if (std::holds_alternative<StudentErrors>(law.distribution)) {
        const boost::math::students_t t(std::exp(psi[1]));
        for (Eigen::Index i = 0; i < e.size(); ++i) {
            const double tail = boost::math::cdf(boost::math::complement(t, std::fabs(e[i]) * std::exp(-psi[0])));
            result[i] = normal_score(tail, e[i]);
        }
        return result;
    }
    if (std::holds_alternative<LaplaceErrors>(law.distribution)) {
        for (Eigen::Index i = 0; i < e.size(); ++i)
            result[i] = normal_score(laplace_tail(std::fabs(e[i]) * std::exp(-psi[0])), e[i]);
        return result;
    }
    if (std::holds_alternative<RelativeErrors>(law.distribution)) {
        assert(observed.size() == e.size());
        const double scale = std::exp(psi[0]);
        const double factor = std::exp(psi[1]);
        for (Eigen::Index i = 0; i < e.size(); ++i)
            result[i] = e[i] / std::hypot(scale, factor * (observed[i] - e[i]));
        return result;
    }
    return whitened(law, e, psi);
}

}  // namespace orbid::estimator

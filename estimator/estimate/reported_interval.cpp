#include "estimator/estimate/reported_interval.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <boost/math/distributions/chi_squared.hpp>

#include "estimator/interface/not_finite.hpp"
#include "estimator/uncertainty/bounded_interval.hpp"
#include "estimator/uncertainty/normality.hpp"

namespace orbid::estimator {

namespace {

/// ln 1000 / 1.96: an interval of a factor of a thousand to both sides tells not even an order of magnitude.
constexpr double untold_sd = 3.52;
/// Parts of a direction below a tenth of its largest do not make a parameter unknown.
constexpr double untold_part = 0.1;

/// Whether the data tell not even the order of magnitude of a parameter on a logarithmic scale, because it is part of a
/// product that they do not tell. Then there is no interval: the direction says more than huge numbers.
bool is_untold(const Problem& problem, const Posterior& posterior, Eigen::Index i, double sd) {
    const FreeParameter& parameter = problem.parameters[static_cast<std::size_t>(i)];
    if (parameter.scale != Scale::log && parameter.scale != Scale::log10) return false;
    const double unit = parameter.scale == Scale::log10 ? std::numbers::ln10 : 1.0;
    const auto& directions = posterior.identifiable().sloppy_directions;
    return sd * unit >= untold_sd && std::any_of(directions.begin(), directions.end(), [&](const auto& direction) {
               return direction.sd >= untold_sd && std::abs(direction.components[i]) >= untold_part;
           });
}

void fill_at_bound(const Problem& problem, const State& state, const Minimum& minimum, const Posterior& posterior,
                   Eigen::Index i, Estimated& result) {
    if (!(problem.lower[i] < problem.upper[i])) return;
    const ReducedProblem& reduced = posterior.reduced_problem();
    const ReleasedParameter own =
        released(reduced.r.transpose() * reduced.r + minimum.prior.rows.transpose() * minimum.prior.rows,
                 reduced.r.transpose() * reduced.rhs + minimum.prior.gradient, minimum.step.free, i);
    if (!(own.sd > 0.0)) return;
    Uncertainty widest{0.0, 1.0, normal_975, nan_value, IntervalMethod::normal};
    double widening = 1.0;
    for (const Eigen::Index k : minimum.step.free) {
        const Uncertainty other = posterior.along(Eigen::VectorXd::Unit(state.u.size(), k));
        if (!(other.sd > 0.0) || !(other.laplace_sd > 0.0)) continue;
        if (!(other.sd * other.quantile > widening * normal_975 * other.laplace_sd) && widest.sd > 0.0) continue;
        widening = std::max(1.0, other.sd / other.laplace_sd);
        widest = other;
    }
    if (minimum.step.free.empty())
        for (const Autocorrelation& correlation : posterior.autocorrelations())
            widening = std::max(widening, std::sqrt(correlation.records));
    const Coordinate& coordinate = problem.coordinates[static_cast<std::size_t>(i)];
    const BoundedInterval interval =
        bounded_interval(state.u[i] + own.step, own.sd * widening, widest.quantile, problem.lower[i], problem.upper[i]);
    if (interval.limit == BoundSide::none) return;
    result.lower95 = coordinate.natural(interval.lower);
    result.upper95 = coordinate.natural(interval.upper);
    result.limit = interval.limit;
    result.interval_method = widest.method;
}

}  // namespace

Eigen::VectorXd slopes(const Problem& problem, const Eigen::VectorXd& theta) {
    Eigen::VectorXd slope(theta.size());
    for (Eigen::Index i = 0; i < theta.size(); ++i)
        slope[i] = problem.coordinates[static_cast<std::size_t>(i)].slope(theta[i]);
    return slope;
}

void fill_interval(const Problem& problem, const State& state, const Minimum& minimum, const Posterior& posterior,
                   Eigen::Index parameter, Estimated& result) {
    const Uncertainty uncertainty = posterior.along(Eigen::VectorXd::Unit(state.u.size(), parameter));
    result.interval_method = uncertainty.method;
    result.lower95 = result.upper95 = nan_value;
    if (result.at_bound != BoundSide::none) return fill_at_bound(problem, state, minimum, posterior, parameter, result);
    if (is_untold(problem, posterior, parameter, uncertainty.sd)) {
        result.interval_method = IntervalMethod::none;
        return;
    }
    const Coordinate& coordinate = problem.coordinates[static_cast<std::size_t>(parameter)];
    const BoundedInterval interval = bounded_interval(state.u[parameter], uncertainty.sd, uncertainty.quantile,
                                                      problem.lower[parameter], problem.upper[parameter]);
    result.lower95 = coordinate.natural(interval.lower);
    result.upper95 = coordinate.natural(interval.upper);
    result.limit = interval.limit;
}

void fill_interval(const Problem& problem, const State& state, const Posterior& posterior,
                   const DerivedQuantity& quantity, const Eigen::VectorXd& gradient, Estimated& result) {
    const Uncertainty uncertainty = posterior.along(gradient);
    result.interval_method = uncertainty.method;
    result.lower95 = result.value - uncertainty.quantile * uncertainty.sd;
    result.upper95 = result.value + uncertainty.quantile * uncertainty.sd;
    const Eigen::VectorXd moved = (posterior.covariance() * gradient) / uncertainty.sd;  // by one sd of the quantity
    if (!(uncertainty.sd > 0.0) || !moved.allFinite()) return;
    double bottom = -infinity;
    double top = infinity;
    for (Eigen::Index i = 0; i < moved.size(); ++i) {
        if (moved[i] == 0.0) continue;
        const double one = (problem.lower[i] - state.u[i]) / moved[i];
        const double other = (problem.upper[i] - state.u[i]) / moved[i];
        bottom = std::max(bottom, std::min(one, other));
        top = std::min(top, std::max(one, other));
    }
    const BoundedInterval along = bounded_interval(0.0, 1.0, uncertainty.quantile, bottom, top);
    const auto at = [&](double sds) {
        const Eigen::VectorXd u = (state.u + sds * moved).cwiseMax(problem.lower).cwiseMin(problem.upper);
        return quantity.value(natural_parameters(problem, u));
    };
    const double lower = at(along.lower);
    const double upper = at(along.upper);
    if (!(lower < result.value && result.value < upper)) return;
    result.lower95 = lower;
    result.upper95 = upper;
    result.limit = along.limit;
}

void fill_interval(EstimatedScale& scale) {
    const double relative = scale.uncertainty / scale.value;
    const double degrees = 0.5 / (relative * relative);
    if (!(relative > 0.0) || !std::isfinite(degrees)) return;
    // Without promotion to long double, which costs three times as much for digits that no interval has.
    using Policy = boost::math::policies::policy<boost::math::policies::promote_double<false>>;
    const boost::math::chi_squared_distribution<double, Policy> density(degrees);
    // Over nu. Of very many the library's series does not end, and the cube of a normal number is right to 1 / nu
    // (Wilson and Hilferty 1931).
    const auto quantile = [&](double probability, double normal) {
        constexpr double many = 1e9;
        if (degrees < many) return boost::math::quantile(density, probability) / degrees;
        const double part = 2.0 / (9.0 * degrees);
        return std::pow(1.0 - part + normal * std::sqrt(part), 3);
    };
    scale.lower95 = scale.value / std::sqrt(quantile(0.975, normal_975));
    scale.upper95 = scale.value / std::sqrt(quantile(0.025, -normal_975));
    scale.interval_method = IntervalMethod::chi_squared;
}

}  // namespace orbid::estimator

#include "estimator/exploration/derived_marginal.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <boost/math/interpolators/makima.hpp>

#include "estimator/exploration/log_density_spline.hpp"
#include "estimator/interface/not_finite.hpp"

namespace orbid::estimator {

namespace {

/// Slopes below this fraction of the largest (times the parameters' sds) count as zero.
constexpr double no_slope = 1e-10;

/// Equal steps of a mixture: its components are as wide as what is left of phi, and the density is smooth.
constexpr int components = 400;

LogDensitySpline density_of(const Marginal& marginal) {
    std::vector<double> u;
    std::vector<double> value;
    for (const MarginalPoint& point : marginal.points) {
        u.push_back(point.u);
        value.push_back(point.log_density);
    }
    return {u, value};
}

/// A smooth curve through values on the grid.
class Curve {
public:
    Curve(const Marginal& marginal, std::vector<double> values) : curve_(abscissas(marginal), std::move(values)) {}
    double operator()(double u) const { return curve_(u); }

private:
    static std::vector<double> abscissas(const Marginal& marginal) {
        std::vector<double> u;
        for (const MarginalPoint& point : marginal.points)
            u.push_back(point.u);
        return u;
    }
    boost::math::interpolators::makima<std::vector<double>> curve_;
};

struct Component {
    double weight;
    double mean;
    double sd;
};

double mixture_cdf(const std::vector<Component>& mixture, double dof, double x) {
    const boost::math::normal_distribution<double> normal;
    double sum = 0.0;
    for (const Component& part : mixture) {
        const double z = (x - part.mean) / part.sd;
        if (!(part.sd > 0.0))
            sum += part.weight * (x < part.mean ? 0.0 : 1.0);
        else if (std::isfinite(dof))
            sum += part.weight * boost::math::cdf(boost::math::students_t_distribution<double>(dof), z);
        else
            sum += part.weight * boost::math::cdf(normal, z);
    }
    return sum;
}

double quantile(const std::vector<Component>& mixture, double dof, double p, double from, double to) {
    for (int halving = 0; halving < 80; ++halving) {
        const double middle = 0.5 * (from + to);
        (mixture_cdf(mixture, dof, middle) < p ? from : to) = middle;
    }
    return 0.5 * (from + to);
}

/// phi alone on the grid: monotone or not.
bool monotone(const std::vector<double>& values) {
    return std::is_sorted(values.begin(), values.end()) || std::is_sorted(values.rbegin(), values.rend());
}

}  // namespace

DerivedMarginal derived_marginal(const DerivedQuantity& quantity, const std::vector<FreeParameter>& parameters,
                                 const Estimate& estimate, const std::vector<Marginal>& marginals) {
    DerivedMarginal result;
    result.name = quantity.name;
    result.mean = result.sd = result.median = result.lower95 = result.upper95 = nan_value;
    const auto count = static_cast<Eigen::Index>(parameters.size());
    Eigen::VectorXd theta(count);
    Eigen::VectorXd sd(count);
    for (Eigen::Index i = 0; i < count; ++i) {
        theta[i] = estimate.parameters[static_cast<std::size_t>(i)].value;
        sd[i] = estimate.parameters[static_cast<std::size_t>(i)].laplace_sd;
    }
    // Correlation of phi with each parameter that has a marginal.
    const Eigen::VectorXd gradient = quantity.gradient(theta);
    Eigen::MatrixXd covariance = estimate.covariance;
    covariance = covariance.unaryExpr([](double c) { return std::isfinite(c) ? c : 0.0; });
    const Eigen::VectorXd with = covariance * gradient;
    const Marginal* best = nullptr;
    Eigen::Index along = -1;
    double most = -1.0;
    for (const Marginal& marginal : marginals)
        for (Eigen::Index i = 0; i < count; ++i) {
            if (parameters[static_cast<std::size_t>(i)].name != marginal.name || !marginal.known) continue;
            const double share = covariance(i, i) > 0.0 ? with[i] * with[i] / covariance(i, i) : 0.0;
            if (share > most) {
                most = share;
                best = &marginal;
                along = i;
            }
        }
    if (best == nullptr) {
        result.message = "no parameter has a marginal";
        return result;
    }
    result.along = best->name;
    const LogDensitySpline density = density_of(*best);
    std::vector<double> values;
    std::vector<double> ln_variance;
    bool single = true;
    double dof = 0.0;
    for (const MarginalPoint& point : best->points) {
        const Eigen::VectorXd slope = quantity.gradient(point.theta);
        const double value = quantity.value(point.theta);
        if (!std::isfinite(value) || !slope.allFinite()) {
            result.message = "cannot be computed where " + best->name + " = " + std::to_string(point.value);
            return result;
        }
        const double variance = slope.dot(point.covariance * slope);
        for (Eigen::Index i = 0; i < count; ++i) {
            const double own = std::abs(slope[along]) * sd[along];
            const double other = std::abs(slope[i]) * (std::isfinite(sd[i]) ? sd[i] : std::abs(point.theta[i]));
            single = single && (i == along || !(other > no_slope * own));
        }
        values.push_back(value);
        ln_variance.push_back(std::log(std::max(variance, std::numeric_limits<double>::min())));
        dof = point.degrees_of_freedom;
    }
    const Curve phi(*best, values);
    if (single && monotone(values)) {
        result.method = "transformed";
        // phi itself at the natural value of the parameter, not the curve: exact between the points too.
        const Curve natural(*best, [&] {
            std::vector<double> x;
            for (const MarginalPoint& point : best->points)
                x.push_back(point.value);
            return x;
        }());
        const auto at = [&](double value) {
            Eigen::VectorXd here = theta;
            here[along] = value;
            return quantity.value(here);
        };
        result.median = at(best->median);
        result.lower95 = std::min(at(best->lower95), at(best->upper95));
        result.upper95 = std::max(at(best->lower95), at(best->upper95));
        const auto mapped = [&](double u) { return at(natural(u)); };
        result.mean = density.expectation(mapped);
        result.sd = std::sqrt(
            density.expectation([&](double u) { return (mapped(u) - result.mean) * (mapped(u) - result.mean); }));
        result.known = true;
        return result;
    }
    result.method = "mixture";
    const bool scales = std::any_of(estimate.scales.begin(), estimate.scales.end(),
                                    [](const EstimatedScale& scale) { return scale.estimated && scale.count > 0; });
    if (!scales) dof = std::numeric_limits<double>::infinity();
    const Curve spread(*best, ln_variance);
    std::vector<Component> mixture;
    const double from = best->points.front().u;
    const double to = best->points.back().u;
    double sum = 0.0;
    for (int k = 0; k < components; ++k) {
        const double u = from + (to - from) * (k + 0.5) / components;
        const double weight = std::exp(density.log_density(u));
        mixture.push_back({weight, phi(u), std::exp(0.5 * spread(u))});
        sum += weight;
    }
    // Variance of t_nu is nu / (nu - 2) times the square of its scale.
    const double factor = !std::isfinite(dof) ? 1.0 : dof > 2.0 ? dof / (dof - 2.0) : nan_value;
    double first = 0.0;
    double second = 0.0;
    double low = std::numeric_limits<double>::infinity();
    double high = -low;
    for (Component& part : mixture) {
        part.weight /= sum;
        first += part.weight * part.mean;
        second += part.weight * (part.mean * part.mean + factor * part.sd * part.sd);
        // The requested quantiles lie within 50 sds of any t with two degrees of freedom or more, and of some with one.
        low = std::min(low, part.mean - 50.0 * part.sd);
        high = std::max(high, part.mean + 50.0 * part.sd);
    }
    result.mean = first;
    result.sd = std::sqrt(std::max(second - first * first, 0.0));
    result.median = quantile(mixture, dof, 0.5, low, high);
    result.lower95 = quantile(mixture, dof, 0.025, low, high);
    result.upper95 = quantile(mixture, dof, 0.975, low, high);
    result.known = true;
    return result;
}

}  // namespace orbid::estimator

#include "estimator/coordinate.hpp"

#include <algorithm>
#include <cmath>

namespace orbid::estimator {

double Coordinate::at(double natural) const {
    return scale == Scale::log ? std::log(natural) : natural;
}

double Coordinate::natural(double u) const {
    return scale == Scale::log ? std::exp(u) : u;
}

double Coordinate::slope(double natural) const {
    return scale == Scale::log ? natural : 1.0;
}

PriorTerm Coordinate::term(const Prior& prior, double u) const {
    if (!is_proper(prior)) return {};
    if (const auto* log_normal = std::get_if<LogNormalPrior>(&prior); log_normal && scale == Scale::log) {
        // Normal in u: written in u itself, so that nothing cancels.
        const double precision = 1.0 / (log_normal->log_sd * log_normal->log_sd);
        const double distance = u - std::log(log_normal->median);
        return {negative_log_density(prior, natural(u)) - u, distance * precision, precision};
    }
    const double x = natural(u);
    const double slope_x = slope(x);
    const double jacobian = scale == Scale::log ? u : 0.0;
    const double value = negative_log_density(prior, x) - jacobian;
    if (!std::isfinite(value)) return {std::numeric_limits<double>::infinity(), 0.0, 0.0};
    const PriorDerivatives natural_terms = derivatives(prior, x);
    PriorTerm term{value, natural_terms.first * slope_x, natural_terms.second * slope_x * slope_x};
    if (scale == Scale::log) {
        term.curvature += natural_terms.first * x;  // d^2x/du^2 = x
        term.gradient -= 1.0;
    }
    if (!(term.curvature > 0.0)) {
        // Far from the mode the density may be concave in u: its Gauss-Newton part is a safe curvature there.
        if (const auto* normal = std::get_if<NormalPrior>(&prior))
            term.curvature = (slope_x / normal->sd) * (slope_x / normal->sd);
        else if (const auto* log_normal = std::get_if<LogNormalPrior>(&prior))
            term.curvature = 1.0 / (x * x * log_normal->log_sd * log_normal->log_sd);
        else
            term.curvature = 0.0;
    }
    return term;
}

double Coordinate::prior_sd(const Prior& prior, double natural) const {
    if (const auto* log_normal = std::get_if<LogNormalPrior>(&prior))
        return scale == Scale::log ? log_normal->log_sd : log_normal->log_sd * natural;
    const double sd = standard_deviation(prior);
    return scale == Scale::log ? sd / std::abs(natural) : sd;
}

}  // namespace orbid::estimator

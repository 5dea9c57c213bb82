#include "orbits/cycle_target.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>
#include <stdexcept>
#include <variant>

#include <Eigen/Cholesky>

#include "periodic/multiple_shooting.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// A state of rest is measured at most this far from where it is, relative to the range of the attractor: ten times the
/// largest reading error that is usual (5e-3 of the range), and small beside the distance to the next orbit.
constexpr double nearness = 0.05;

/// Movement of a point, relative to its range, per relative change of a parameter: an orbit that moves less than this
/// moves by rounding only. Orbits that carry information move by 1e-3 and more.
constexpr double standstill = 1e-9;

/// Errors of points are positions on a circle or about an origin: they are not relative to a size, and the points of a
/// cycle are no course in time.
void check_forms(Index n, const CycleTargetOptions& options) {
    if (!options.forms.empty() && static_cast<Index>(options.forms.size()) != n)
        throw std::invalid_argument("cycle residual: " + std::to_string(options.forms.size()) +
                                    " error distributions, the model has " + std::to_string(n) + " coordinates");
    const bool linked = options.weights == CycleWeights::covariance;
    for (const ErrorForm& form : options.forms) {
        const bool normal = std::holds_alternative<estimator::NormalErrors>(form.distribution);
        const bool heavy = std::holds_alternative<estimator::StudentErrors>(form.distribution) ||
                           std::holds_alternative<estimator::LaplaceErrors>(form.distribution);
        if (!normal && !heavy)
            throw std::invalid_argument("cycle residual: errors must be normal, Student's t or Laplace");
        if (!normal && linked)
            throw std::invalid_argument(R"(cycle residual: with weights "covariance" errors must be normal)");
        if (form.known_sds) throw std::invalid_argument("cycle residual: a column of sds belongs to a series");
    }
    if (!options.covariances.empty() && linked)
        throw std::invalid_argument(R"(cycle residual: a full covariance of coordinates needs weights "equal")");
}

void check(const models::System& system, const std::vector<Cycle>& cycles, const CycleTargetOptions& options) {
    const Index n = system.dimension();
    if (!options.errors.empty() && static_cast<Index>(options.errors.size()) != n)
        throw std::invalid_argument("cycle residual: " + std::to_string(options.errors.size()) +
                                    " error scales, the model has " + std::to_string(n) + " coordinates");
    check_forms(n, options);
    for (std::size_t c = 0; c < cycles.size(); ++c) {
        const Cycle& cycle = cycles[c];
        const std::string who = "cycle " + std::to_string(c) + ": ";
        if (cycle.period < 1 || cycle.points.rows() != n || cycle.points.cols() != cycle.period)
            throw std::invalid_argument(who + "points have shape (" + std::to_string(cycle.points.rows()) + ", " +
                                        std::to_string(cycle.points.cols()) + "), needed is (" + std::to_string(n) +
                                        ", period) with period " + std::to_string(cycle.period) + " >= 1");
        if (!cycle.points.allFinite()) throw std::invalid_argument(who + "points must be finite");
        if (options.weights != CycleWeights::covariance) continue;
        const Index records = cycle.points.size();
        if (cycle.covariance.rows() != records || cycle.covariance.cols() != records)
            throw std::invalid_argument(who + "covariance must be " + std::to_string(records) + " x " +
                                        std::to_string(records) + R"( (weights "equal" need none))");
        if (!cycle.covariance.allFinite() || Eigen::LLT<MatrixXd>(cycle.covariance).info() != Eigen::Success)
            throw std::invalid_argument(who + "covariance must be finite, symmetric and positive definite");
    }
}

bool rests(const SectionMap& map, const VectorXd& theta, std::span<const Index> free, const Cycle& cycle,
           const VectorXd& scale) {
    if (cycle.period != 1) return false;
    const models::System& system = map.system();
    const VectorXd point = cycle.points.col(0);
    const auto image = map(point, theta, free, false);
    const auto near = [&](const VectorXd& other) {
        return (wrapped_difference(system, other, point).array() / scale.array()).abs().maxCoeff() < nearness;
    };
    // Every fixed point of a map is at rest: only that it stays where it is for all parameters makes it tell nothing.
    const bool can_rest = system.kind() != models::Kind::map;
    if (can_rest && image && system.at_rest(image->state, theta) && near(image->state)) return true;

    periodic::ShootingOptions options;
    options.scale = scale;
    options.maximum_distance = nearness;
    options.flow = map.flow();
    const periodic::PeriodicOrbit orbit =
        periodic::solve_multiple_shooting(system, theta, map.phase(), point, {}, free, options);
    if (orbit.status != periodic::OrbitStatus::converged) return false;
    if (can_rest && system.at_rest(orbit.points.col(0), theta)) return true;
    if (free.empty()) return false;
    double movement = 0.0;
    for (Index k = 0; k < orbit.sensitivities.cols(); ++k) {
        const Index parameter = free[static_cast<std::size_t>(k)];
        const double size =
            std::max(std::abs(theta(parameter)), system.parameters()[static_cast<std::size_t>(parameter)].typical_size);
        movement = std::max(movement, size * (orbit.sensitivities.col(k).array() / scale.array()).abs().maxCoeff());
    }
    return movement < standstill;
}

/// Relative to the range: what a computed orbit may be off by, a flow of tolerance 1e-12 times what the orbit's own
/// instability makes of it. Clean series give points better than that; without this share the residuals of such points
/// would measure our integrator, and their rounding would stop the minimiser before it has converged.
constexpr double computed_orbit_error = 1e-10;

}  // namespace

CycleTargets select_targets(const SectionMap& map, const VectorXd& theta, std::span<const Index> free,
                            const std::vector<Cycle>& cycles, const CycleTargetOptions& options) {
    check(map.system(), cycles, options);
    const VectorXd scale = target_scale(map.system(), cycles);
    CycleTargets result;
    for (std::size_t c = 0; c < cycles.size(); ++c) {
        const Cycle& cycle = cycles[c];
        const bool wanted =
            options.periods.empty() || std::count(options.periods.begin(), options.periods.end(), cycle.period) > 0;
        if (!wanted) continue;
        if (cycle.mirror && *cycle.mirror < c) {
            result.mirrored.push_back(c);
            continue;
        }
        if (rests(map, theta, free, cycle, scale)) {
            result.at_rest.push_back(c);
            continue;
        }
        CycleTarget target;
        target.cycle = c;
        target.label = "cycle " + std::to_string(c) + " (period " + std::to_string(cycle.period) + ")";
        target.rotation = cycle.rotation;
        target.points = cycle.points;
        if (options.weights == CycleWeights::covariance) {
            target.covariance = cycle.covariance;
            for (Index k = 0; k < target.covariance.rows(); ++k) {
                const double error = computed_orbit_error * scale(k % scale.size());
                target.covariance(k, k) += error * error;
            }
        }
        result.targets.push_back(std::move(target));
    }
    return result;
}

std::vector<estimator::Group> target_groups(const models::System& system, const std::string& prefix,
                                            const CycleTargetOptions& options) {
    std::vector<estimator::Group> groups;
    for (std::size_t i = 0; i < system.coordinates().size(); ++i) {
        const models::Coordinate& coordinate = system.coordinates()[i];
        estimator::Group group;
        group.name = prefix + "." + std::string(coordinate.name);
        group.factor = options.weights == CycleWeights::covariance;
        group.unit = group.factor ? "1" : std::string(coordinate.unit);
        // <= 0: the estimator takes the start from the residuals.
        group.scale =
            options.errors.empty() ? estimator::ErrorScale{true, 0.0, estimator::FlatPrior{}} : options.errors[i];
        if (!options.forms.empty()) {
            group.distribution = options.forms[i].distribution;
            group.floor = options.forms[i].floor;
        }
        groups.push_back(std::move(group));
    }
    return groups;
}

std::vector<int> record_groups(Index dimension, Index points, int first) {
    std::vector<int> groups;
    for (Index j = 0; j < points; ++j)
        for (Index i = 0; i < dimension; ++i)
            groups.push_back(first + static_cast<int>(i));
    return groups;
}

VectorXd target_scale(const models::System& system, const std::vector<Cycle>& cycles) {
    VectorXd scale = VectorXd::Zero(system.dimension());
    for (Index i = 0; i < scale.size(); ++i) {
        if (system.coordinates()[static_cast<std::size_t>(i)].angle) {
            scale(i) = 2.0 * std::numbers::pi;
            continue;
        }
        for (const Cycle& cycle : cycles)
            scale(i) = std::max(scale(i), 2.0 * cycle.points.row(i).cwiseAbs().maxCoeff());
        if (!(scale(i) > 0.0)) scale(i) = 1.0;
    }
    return scale;
}

}  // namespace orbid::orbits

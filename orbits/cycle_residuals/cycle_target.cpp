#include "orbits/cycle_residuals/cycle_target.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>
#include <stdexcept>
#include <variant>

#include "models/arithmetic/cholesky_factor.hpp"
#include "orbits/simulation/point_reading.hpp"
#include "periodic/solution/multiple_shooting.hpp"

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

/// What a computed ln|multiplier| may be off by: integrated second derivatives and a flow of tolerance 1e-12, times
/// what the orbit's instability makes of it.
constexpr double computed_multiplier_error = 1e-9;

/// Errors of points are positions on a circle or about an origin: they are not relative to a size, and the points of a
/// cycle are no course in time.
void check_forms(Index n, const CycleTargetOptions& options) {
    if (!options.forms.empty() && static_cast<Index>(options.forms.size()) != n)
        throw std::invalid_argument("cycle residual: " + std::to_string(options.forms.size()) +
                                    " error distributions, the section has " + std::to_string(n) + " coordinates");
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

void check_multipliers(const Cycle& cycle, const std::string& who, bool covariance) {
    const Index count = cycle.ln_multiplier.size();
    if (count == 0) return;
    if (cycle.multipliers.size() != static_cast<std::size_t>(count) && !cycle.multipliers.empty())
        throw std::invalid_argument(who + "has " + std::to_string(cycle.multipliers.size()) + " multipliers and " +
                                    std::to_string(count) + " values of ln|multiplier|");
    if (!covariance) return;
    if (cycle.ln_multiplier_covariance.rows() != count || cycle.ln_multiplier_covariance.cols() != count)
        throw std::invalid_argument(who + "covariance of ln|multiplier| must be " + std::to_string(count) + " x " +
                                    std::to_string(count) + R"( (weights "equal" need none))");
}

void check(const SectionMap& map, const std::vector<Cycle>& cycles, const CycleTargetOptions& options) {
    const Index n = map.dimension();
    if (!options.positions && !options.multipliers && !options.times)
        throw std::invalid_argument("cycle residual: positions or multipliers must take part");
    if (options.times && !map.place().plane)
        throw std::invalid_argument("cycle residual: only cycles of autonomous flows have a time of their own");
    if (!options.errors.empty() && static_cast<Index>(options.errors.size()) != n)
        throw std::invalid_argument("cycle residual: " + std::to_string(options.errors.size()) +
                                    " error scales, the section has " + std::to_string(n) + " coordinates");
    check_forms(n, options);
    for (std::size_t c = 0; c < cycles.size(); ++c) {
        const Cycle& cycle = cycles[c];
        const std::string who = "cycle " + std::to_string(c) + ": ";
        if (cycle.period < 1 || cycle.points.rows() != n || cycle.points.cols() != cycle.period)
            throw std::invalid_argument(who + "points have shape (" + std::to_string(cycle.points.rows()) + ", " +
                                        std::to_string(cycle.points.cols()) + "), needed is (" + std::to_string(n) +
                                        ", period) with period " + std::to_string(cycle.period) + " >= 1");
        if (!cycle.points.allFinite()) throw std::invalid_argument(who + "points must be finite");
        if (options.multipliers) check_multipliers(cycle, who, options.weights == CycleWeights::covariance);
        if (options.weights != CycleWeights::covariance || !options.positions) continue;
        const Index records = cycle.points.size();
        if (cycle.covariance.rows() != records || cycle.covariance.cols() != records)
            throw std::invalid_argument(who + "covariance must be " + std::to_string(records) + " x " +
                                        std::to_string(records) + R"( (weights "equal" need none))");
        if (!cycle.covariance.allFinite() || !models::CholeskyFactor(cycle.covariance).positive_definite())
            throw std::invalid_argument(who + "covariance must be finite, symmetric and positive definite");
    }
}

bool rests(const SectionMap& map, const VectorXd& theta, std::span<const Index> free, const MatrixXd& nodes,
           const VectorXd& scale) {
    if (nodes.cols() != 1 || map.place().plane) return false;
    const models::System& system = map.system();
    const VectorXd point = nodes.col(0);
    const auto image = map(point, theta, free, false);
    const auto near = [&](const VectorXd& other) {
        return (map.difference(other, point).array() / scale.array()).abs().maxCoeff() < nearness;
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
/// The same of T.
constexpr double computed_time_error = 1e-11;

/// Points with their covariance, as far as they take part.
void take_positions(const Cycle& cycle, const VectorXd& scale, const CycleTargetOptions& options, CycleTarget& target) {
    if (options.weights != CycleWeights::covariance) return;
    target.covariance = cycle.covariance;
    for (Index k = 0; k < target.covariance.rows(); ++k) {
        const double error = computed_orbit_error * scale(k % scale.size());
        target.covariance(k, k) += error * error;
    }
}

void take_time(const Cycle& cycle, const CycleTargetOptions& options, CycleTarget& target) {
    if (!std::isfinite(cycle.time)) return;
    if (options.weights == CycleWeights::covariance) {
        if (!(cycle.time_sd > 0.0) || !std::isfinite(cycle.time_sd)) return;
        target.time_sd = std::hypot(cycle.time_sd, computed_time_error * cycle.time);
    }
    target.time = cycle.time;
}

void take_multipliers(const Cycle& cycle, const CycleTargetOptions& options, CycleTarget& target) {
    const bool weighted = options.weights == CycleWeights::covariance;
    std::vector<Index> taken;
    for (Index m = 0; m < cycle.ln_multiplier.size(); ++m) {
        const auto slot = static_cast<std::size_t>(m);
        const bool pair = !cycle.multipliers.empty() && cycle.multipliers[slot].imag() != 0.0;
        // A pair stands as two conjugates with equal moduli, the one with the positive imaginary part first.
        if (pair && cycle.multipliers[slot].imag() < 0.0) continue;
        if (!std::isfinite(cycle.ln_multiplier(m))) continue;
        if (weighted) {
            const double variance = cycle.ln_multiplier_covariance(m, m);
            if (!(variance > 0.0 && variance <= largest_multiplier_sd * largest_multiplier_sd)) continue;
        }
        taken.push_back(m);
        target.multipliers.push_back(slot);
        target.pair.push_back(pair);
    }
    target.ln_multiplier = cycle.ln_multiplier(taken);
    if (!weighted) return;
    target.multiplier_covariance = cycle.ln_multiplier_covariance(taken, taken);
    target.multiplier_covariance.diagonal().array() += computed_multiplier_error * computed_multiplier_error;
    if (!taken.empty() && !models::CholeskyFactor(target.multiplier_covariance).positive_definite())
        throw std::invalid_argument("cycle " + std::to_string(target.cycle) +
                                    ": covariance of ln|multiplier| must be symmetric and positive definite");
}

}  // namespace

CycleTargets select_targets(const SectionMap& map, const VectorXd& theta, std::span<const Index> free,
                            const std::vector<Cycle>& cycles, const CycleTargetOptions& options) {
    check(map, cycles, options);
    const VectorXd scale = target_scale(map.coordinates(), cycles);
    const PointReading reading(map, options.sensor);
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
        CycleTarget target;
        target.cycle = c;
        target.label = "cycle " + std::to_string(c) + " (period " + std::to_string(cycle.period) + ")";
        target.rotation = cycle.rotation;
        target.points = cycle.points;
        target.nodes = reading.states(cycle.points, theta);
        const bool resting = rests(map, theta, free, target.nodes, scale);
        if (resting) result.at_rest.push_back(c);
        target.positions = options.positions && !resting;
        if (target.positions) take_positions(cycle, scale, options, target);
        if (options.multipliers) take_multipliers(cycle, options, target);
        if (options.times) take_time(cycle, options, target);
        if (target.positions || !target.multipliers.empty() || std::isfinite(target.time))
            result.targets.push_back(std::move(target));
    }
    const auto has_multipliers = [](const CycleTarget& target) { return !target.multipliers.empty(); };
    if (options.multipliers && std::none_of(result.targets.begin(), result.targets.end(), has_multipliers))
        throw std::invalid_argument("cycle residual: multipliers are to take part, but none was measured");
    const auto has_time = [](const CycleTarget& target) { return std::isfinite(target.time); };
    if (options.times && std::none_of(result.targets.begin(), result.targets.end(), has_time))
        throw std::invalid_argument("cycle residual: times are to take part, but none was measured");
    return result;
}

std::vector<estimator::Group> target_groups(const SectionMap& map, const std::string& prefix,
                                            const CycleTargetOptions& options) {
    std::vector<estimator::Group> groups;
    for (std::size_t i = 0; options.positions && i < map.coordinates().size(); ++i) {
        const models::Coordinate& coordinate = map.coordinates()[i];
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
    const auto add = [&](const std::string& name, const std::string& unit, const estimator::ErrorScale& scale) {
        estimator::Group group;
        group.name = prefix + "." + name;
        group.factor = options.weights == CycleWeights::covariance;
        group.unit = group.factor ? "1" : unit;
        group.scale = scale;
        groups.push_back(std::move(group));
    };
    if (options.multipliers) add("ln_multiplier", "1", options.multiplier_error);
    if (options.times) add("time", "s", options.time_error);
    return groups;
}

std::vector<int> record_groups(Index dimension, Index points, int first) {
    std::vector<int> groups;
    for (Index j = 0; j < points; ++j)
        for (Index i = 0; i < dimension; ++i)
            groups.push_back(first + static_cast<int>(i));
    return groups;
}

VectorXd target_scale(std::span<const models::Coordinate> coordinates, const std::vector<Cycle>& cycles) {
    VectorXd scale = VectorXd::Zero(static_cast<Index>(coordinates.size()));
    for (Index i = 0; i < scale.size(); ++i) {
        if (coordinates[static_cast<std::size_t>(i)].angle) {
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

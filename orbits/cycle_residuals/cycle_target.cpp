#include "orbits/cycle_residuals/cycle_target.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string_view>
#include <variant>

#include <fmt/format.h>

#include "models/arithmetic/cholesky_factor.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/records/refusal.hpp"
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
    refuse_if(!options.forms.empty() && static_cast<Index>(options.forms.size()) != n,
              "cycle residual: {} error distributions, the section has {} coordinates", options.forms.size(), n);
    const bool linked = options.weights == CycleWeights::covariance;
    for (const ErrorForm& form : options.forms) {
        const bool normal = std::holds_alternative<estimator::NormalErrors>(form.distribution);
        const bool heavy = std::holds_alternative<estimator::StudentErrors>(form.distribution) ||
                           std::holds_alternative<estimator::LaplaceErrors>(form.distribution);
        refuse_if(!normal && !heavy, "cycle residual: errors must be normal, Student's t or Laplace");
        if (!normal && linked)
            throw std::invalid_argument(R"(cycle residual: with weights "covariance" errors must be normal)");
        if (form.known_sds) throw std::invalid_argument("cycle residual: a column of sds belongs to a series");
    }
    if (!options.covariances.empty() && linked)
        throw std::invalid_argument(R"(cycle residual: a full covariance of coordinates needs weights "equal")");
}

void check(const SectionMap& map, const std::vector<Cycle>& cycles, const CycleTargetOptions& options) {
    const Index n = map.dimension();
    refuse_if(!options.positions && !options.multipliers && !options.times,
              "cycle residual: positions or multipliers must take part");
    refuse_if(options.times && !map.place().plane,
              "cycle residual: only cycles of autonomous flows have a time of their own");
    refuse_if(!options.errors.empty() && static_cast<Index>(options.errors.size()) != n,
              "cycle residual: {} error scales, the section has {} coordinates", options.errors.size(), n);
    check_forms(n, options);
    for (std::size_t c = 0; c < cycles.size(); ++c) {
        const Cycle& cycle = cycles[c];
        const std::string who = "cycle " + std::to_string(c) + ": ";
        refuse_if(cycle.period < 1 || cycle.points.rows() != n || cycle.points.cols() != cycle.period,
                  "{}points have shape ({}, {}), needed is ({}, period) with period {} >= 1", who, cycle.points.rows(),
                  cycle.points.cols(), n, cycle.period);
        refuse_if(!cycle.points.allFinite(), "{}points must be finite", who);
        const auto count = static_cast<std::size_t>(cycle.ln_multiplier.size());
        refuse_if(options.multipliers && count > 0 && cycle.multipliers.size() != count && !cycle.multipliers.empty(),
                  "{}has {} multipliers and {} values of ln|multiplier|", who, cycle.multipliers.size(), count);
    }
    check_weights(cycles, options);
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
        if (target.positions && cycle.time_covariance.size() > 0) {
            refuse_if(cycle.time_covariance.size() != cycle.points.size(),
                      "cycle {}: covariance of the time has {} numbers, the points {} coordinates", target.cycle,
                      cycle.time_covariance.size(), cycle.points.size());
            target.time_covariance = cycle.time_covariance;
            const VectorXd weights = models::CholeskyFactor(target.covariance).solve(target.time_covariance);
            // Negated so that nan fails.
            refuse_if(!(target.time_covariance.dot(weights) < target.time_sd * target.time_sd),
                      "cycle {}: time_sd is too small beside time_covariance: they must be those of a covariance of "
                      "points and time",
                      target.cycle);
        }
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
    refuse_if(!taken.empty() && !models::CholeskyFactor(target.multiplier_covariance).positive_definite(),
              "cycle {}: covariance of ln|multiplier| must be symmetric and positive definite", target.cycle);
}

/// The rows of Cycle::common that belong to the records of the target.
void take_common(const Cycle& cycle, const CycleTargetOptions& options, CycleTarget& target) {
    if (options.weights != CycleWeights::covariance || cycle.common.size() == 0) return;
    const Index untimed = cycle.points.size() + cycle.ln_multiplier.size();
    const bool timed = cycle.common.rows() == untimed + 1;
    refuse_if((cycle.common.rows() != untimed && !timed) || !cycle.common.allFinite(),
              "cycle {}: common errors have {} rows, must have {} (coordinates of points, then multipliers), or one "
              "more for the time, all finite",
              target.cycle, cycle.common.rows(), untimed);
    std::vector<Index> rows;
    for (Index k = 0; k < cycle.points.size(); ++k)
        rows.push_back(k);
    for (const std::size_t m : target.multipliers)
        rows.push_back(cycle.points.size() + static_cast<Index>(m));
    target.common = MatrixXd::Zero(std::ssize(rows) + (std::isfinite(target.time) ? 1 : 0), cycle.common.cols());
    target.common.topRows(std::ssize(rows)) = cycle.common(rows, Eigen::all);
    if (std::isfinite(target.time) && timed) target.common.bottomRows(1) = cycle.common.bottomRows(1);
}

}  // namespace

void check_weights(const std::vector<Cycle>& cycles, const CycleTargetOptions& options) {
    if (options.weights != CycleWeights::covariance) return;
    const auto needs = [](bool fulfilled, std::size_t cycle, const std::string& rule) {
        if (!fulfilled) throw DataError(fmt::format("cycle {}: {} (weights \"equal\" need none)", cycle, rule));
    };
    const auto square = [](const MatrixXd& matrix, Index size) {
        return matrix.rows() == size && matrix.cols() == size;
    };
    for (std::size_t c = 0; c < cycles.size(); ++c) {
        const Cycle& cycle = cycles[c];
        const Index logarithms = cycle.ln_multiplier.size(), records = cycle.points.size();
        if (options.multipliers && logarithms > 0)
            needs(square(cycle.ln_multiplier_covariance, logarithms), c,
                  fmt::format("covariance of ln|multiplier| must be {0} x {0}", logarithms));
        if (!options.positions) continue;
        needs(square(cycle.covariance, records), c, fmt::format("covariance must be {0} x {0}", records));
        needs(cycle.covariance.allFinite() && models::CholeskyFactor(cycle.covariance).positive_definite(), c,
              "covariance must be finite, symmetric and positive definite");
    }
}

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
        take_common(cycle, options, target);
        if (target.positions || !target.multipliers.empty() || std::isfinite(target.time))
            result.targets.push_back(std::move(target));
    }
    const auto has_multipliers = [](const CycleTarget& target) { return !target.multipliers.empty(); };
    refuse_if(options.multipliers && std::none_of(result.targets.begin(), result.targets.end(), has_multipliers),
              "cycle residual: multipliers are to take part, but none was measured");
    const auto has_time = [](const CycleTarget& target) { return std::isfinite(target.time); };
    refuse_if(options.times && std::none_of(result.targets.begin(), result.targets.end(), has_time),
              "cycle residual: times are to take part, but none was measured");
    return result;
}

std::vector<estimator::Group> target_groups(const SectionMap& map, const std::string& prefix,
                                            const CycleTargetOptions& options) {
    std::vector<estimator::Group> groups;
    const auto add = [&](std::string_view name, std::string_view unit, const estimator::ErrorScale& scale) {
        estimator::Group& group = groups.emplace_back();
        group.name = fmt::format("{}.{}", prefix, name);
        group.factor = options.weights == CycleWeights::covariance;
        group.unit = group.factor ? "1" : unit;
        group.scale = scale;
    };
    for (std::size_t i = 0; options.positions && i < map.coordinates().size(); ++i) {
        const models::Coordinate& coordinate = map.coordinates()[i];
        // <= 0: the estimator takes the start from the residuals.
        const estimator::ErrorScale from_residuals{true, 0.0, estimator::FlatPrior{}};
        add(coordinate.name, coordinate.unit, options.errors.empty() ? from_residuals : options.errors[i]);
        if (options.forms.empty()) continue;
        groups.back().distribution = options.forms[i].distribution;
        groups.back().floor = options.forms[i].floor;
    }
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

#include "orbits/cycle_residuals/cycle_residual.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include <tbb/parallel_for.h>

#include "models/arithmetic/cholesky_factor.hpp"
#include "models/arithmetic/median.hpp"
#include "models/system/left_loop.hpp"
#include "orbits/cycle_residuals/cycle_block.hpp"
#include "orbits/records/refusal.hpp"
#include "periodic/solution/multiple_shooting.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using periodic::OrbitStatus;
using periodic::PeriodicOrbit;

/// A cycle that was lost or rejected and taken back this often stays out: the set of blocks must settle.
constexpr int most_returns = 2;

/// Steps of Newton's method per orbit: from a predicted start two or three are usual, and an orbit that needs many is
/// on its way to another one.
constexpr int most_newton_steps = 15;

/// Typical sizes of the model's coordinates; of the plane's own, on which nothing moves, any will do.
VectorXd state_scale(const SectionMap& map, const std::vector<Cycle>& cycles) {
    VectorXd scale = map.states(target_scale(map.coordinates(), cycles)).cwiseAbs();
    return (scale.array() > 0.0).select(scale, 1.0);
}

}  // namespace

CycleResidual::CycleResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                             const std::vector<Cycle>& cycles, const SectionPlace& place, const VectorXd& start,
                             const std::vector<MatrixXd>& start_nodes, const CycleResidualOptions& options)
    : system_(std::move(system)),
      binding_(std::move(binding)),
      map_(*system_, place, options.flow),
      reading_(map_, options.targets.sensor),
      options_(options),
      targets_(select_targets(map_, binding_.values(start), binding_.parameter, cycles, options.targets)),
      scale_(state_scale(map_, cycles)) {
    initial_.groups = target_groups(map_, "cycles", options.targets);
    if (!(options.maximum_move > 0.0)) throw std::invalid_argument("CycleResidual: maximum_move must be > 0");
    if (!(options.gate > 1.0)) throw std::invalid_argument("CycleResidual: gate must be > 1");
    refuse_if(!start_nodes.empty() && start_nodes.size() != cycles.size(),
              "CycleResidual: {} start nodes for {} cycles", start_nodes.size(), cycles.size());
    for (const CycleTarget& target : targets_.targets) {
        initial_.layout.edit().emplace_back().label = target.label;
        Known known;
        known.nodes = target.nodes;
        if (!start_nodes.empty() && start_nodes[target.cycle].size() > 0) {
            const MatrixXd& nodes = start_nodes[target.cycle];
            refuse_if(
                nodes.rows() != target.points.rows() || nodes.cols() != target.points.cols() || !nodes.allFinite(),
                "CycleResidual: start nodes of {} must be finite and have the shape of its points", target.label);
            known.nodes = nodes;
        }
        initial_.memory.resize(initial_.memory.size() + memory_parts);
        remember(initial_, initial_.layout.size() - 1, known);
    }
    for (const CycleTarget& target : targets_.targets) {
        refuse_if(target.common.size() > 0 && shared_ > 0 && target.common.cols() != shared_,
                  "CycleResidual: common errors of {} have {} columns, those of a cycle before it {}", target.label,
                  target.common.cols(), shared_);
        if (target.common.size() > 0) shared_ = target.common.cols();
    }
    // Smaller ones would rest on records of small errors, and shrink the shared directions (docs/cycles_as_data.md).
    for (estimator::Group& group : initial_.groups)
        if (shared_ > 0 && group.scale.estimate) group.floor = std::max(group.floor, 1.0);
    initial_.memory.push_back(VectorXd::Zero(1));
    initial_.latents.resize(initial_.layout.size());
    // Solutions at the start give every later one a prediction to first order. A cycle without one keeps its guess.
    const std::vector<PeriodicOrbit> solved = orbits(initial_, start);
    for (std::size_t b = 0; b < solved.size(); ++b) {
        // A state of rest that is no isolated orbit (dry friction) has nothing that could be followed.
        const bool followed = targets_.targets[b].positions || solved[b].status == OrbitStatus::converged;
        const bool laid_out = lay_out(initial_, b, solved[b]);
        initial_.layout.edit()[b].active = laid_out && followed;
        if (solved[b].status == OrbitStatus::converged) keep(initial_, b, solved[b], start);
    }
    if (!start_nodes.empty()) gate_start(solved, start);
    link(initial_);
}

void CycleResidual::gate_start(const std::vector<PeriodicOrbit>& solved, const VectorXd& start) {
    const VectorXd range = map_.points(scale_);
    // Mean squares in units of the cycle's own errors, and of the ranges. The start is not the optimum: what it is off
    // by moves the best measured cycles by thousands of their errors, but all of them by about the same share of the
    // range.
    std::vector<double> size(initial_.layout.size(), 0.0);
    std::vector<double> distance(initial_.layout.size(), 0.0);
    std::vector<double> sizes;
    std::vector<double> distances;
    for (std::size_t b = 0; b < initial_.layout.size(); ++b) {
        const CycleTarget& target = targets_.targets[b];
        if (!initial_.layout[b].active || !target.positions || solved[b].status != OrbitStatus::converged) continue;
        const auto e = residual(initial_, b, solved[b], start);
        if (!e) continue;
        VectorXd whitened = e->head(target.points.size());
        const VectorXd share = whitened.array() / range.replicate(target.points.cols(), 1).array();
        if (target.covariance.size() > 0)
            models::CholeskyFactor(target.covariance).solve_lower_in_place(whitened);
        else
            whitened = share;
        size[b] = whitened.squaredNorm() / static_cast<double>(whitened.size());
        distance[b] = share.squaredNorm() / static_cast<double>(share.size());
        sizes.push_back(size[b]);
        distances.push_back(distance[b]);
    }
    if (sizes.empty()) return;
    const double largest_size = options_.gate * models::upper_median(sizes);
    const double largest_distance = options_.gate * models::upper_median(distances);
    for (std::size_t b = 0; b < initial_.layout.size(); ++b) {
        if (size[b] <= largest_size || distance[b] <= largest_distance) continue;
        initial_.layout.edit()[b].active = false;
        ++rejected_at_start(initial_);
    }
}

CycleResidual::Known CycleResidual::known(const estimator::ActiveSet& active, std::size_t block) const {
    const VectorXd* part = &active.memory[memory_parts * block];
    const Index n = map_.dimension();
    Known known;
    known.nodes = part[0].reshaped(n, part[0].size() / n);
    known.theta = part[1];
    known.sensitivities = part[2].reshaped(part[0].size(), part[2].size() / part[0].size());
    known.multipliers = part[3][0] != 0.0;
    known.taken_back = static_cast<int>(part[3][1]);
    for (Index i = 2; i < part[3].size(); ++i)
        known.rotation.push_back(static_cast<int>(part[3][i]));
    return known;
}

void CycleResidual::remember(estimator::ActiveSet& active, std::size_t block, const Known& known) {
    VectorXd* part = &active.memory[memory_parts * block];
    part[0] = known.nodes.reshaped();
    part[1] = known.theta;
    part[2] = known.sensitivities.reshaped();
    part[3].resize(2 + std::ssize(known.rotation));
    part[3][0] = known.multipliers ? 1.0 : 0.0;
    part[3][1] = known.taken_back;
    for (std::size_t i = 0; i < known.rotation.size(); ++i)
        part[3][static_cast<Index>(i) + 2] = known.rotation[i];
}

bool CycleResidual::has_multipliers(const estimator::ActiveSet& active, std::size_t block) {
    return active.memory[memory_parts * block + 3][0] != 0.0;
}

double& CycleResidual::taken_back(estimator::ActiveSet& active, std::size_t block) {
    return active.memory[memory_parts * block + 3][1];
}

void CycleResidual::keep(estimator::ActiveSet& active, std::size_t block, const PeriodicOrbit& orbit,
                         const VectorXd& theta) const {
    Known known = this->known(active, block);
    known.nodes = map_.points(orbit.points);
    known.theta = theta;
    known.sensitivities = binding_.spread(map_.points(orbit.sensitivities));
    known.rotation = orbit.rotation;
    remember(active, block, known);
}

PeriodicOrbit CycleResidual::solve(const estimator::ActiveSet& active, std::size_t block, const VectorXd& theta,
                                   bool derivatives) const {
    const Known known = this->known(active, block);
    const VectorXd values = binding_.values(theta);
    if (!in_domain(*system_, values)) {
        PeriodicOrbit none;
        none.status = OrbitStatus::not_simulated;
        return none;
    }
    periodic::ShootingOptions options;
    options.scale = scale_;
    options.maximum_distance = options_.maximum_move;
    options.maximum_iterations = most_newton_steps;
    options.flow = options_.flow;
    // Newton's last step is still taken: what is left is of the order of its square, far below the error of the flow.
    options.tolerance = 1e-9;
    const std::vector<Index> none;
    const std::vector<Index>& free = derivatives ? binding_.parameter : none;
    const auto from = [&](const MatrixXd& guess) {
        periodic::StartingSolution start;
        start.points = map_.states(guess);
        start.rotation = known.rotation;
        start.phase = map_.phase();
        start.section = map_.place().plane;
        return periodic::solve_multiple_shooting(*system_, values, start, free, options);
    };
    if (known.theta.size() > 0) {
        const VectorXd move = known.sensitivities * (theta - known.theta);
        const MatrixXd predicted = known.nodes + move.reshaped(known.nodes.rows(), known.nodes.cols());
        if (predicted.allFinite()) {
            PeriodicOrbit orbit = from(predicted);
            if (orbit.status == OrbitStatus::converged) return orbit;
        }
    }
    return from(known.nodes);
}

std::vector<estimator::BlockValue> CycleResidual::evaluate(const estimator::ActiveSet& active, const VectorXd& theta,
                                                           const std::vector<VectorXd>&, bool derivatives) const {
    const VectorXd values = binding_.values(theta);
    // Blocks that were left out for a while (folds of a validation, orbits that stopped a step) still tell of others.
    std::vector<estimator::BlockLayout> asked = active.layout;
    for (std::size_t b = 0; shared_ > 0 && b < asked.size(); ++b)
        asked[b].active = asked[b].active || active.memory[memory_parts * b + gain_part].size() > 0;
    auto found = evaluate_blocks(*system_, values, asked, [&](std::size_t b, estimator::BlockValue& block) {
        const PeriodicOrbit orbit = solve(active, b, theta, derivatives);
        if (orbit.status != OrbitStatus::converged) return false;
        const auto readings = reading_(map_.points(orbit.points), values, binding_.parameter, derivatives);
        if (!readings) return false;
        const auto e = residual(active, b, orbit, *readings);
        if (!e) return false;
        block.e = *e;
        block.e_z.resize(e->size(), 0);
        if (!derivatives) return true;
        const auto slope = derivative(active, b, orbit, *readings, values);
        if (!slope) return false;
        block.e_theta = *slope;
        return true;
    });
    if (shared_ > 0) subtract_known(active, found, derivatives);
    return found;
}

std::vector<PeriodicOrbit> CycleResidual::orbits(const estimator::ActiveSet& active, const VectorXd& theta) const {
    std::vector<PeriodicOrbit> result(active.layout.size());
    tbb::parallel_for(std::size_t{0}, result.size(), [&](std::size_t b) { result[b] = solve(active, b, theta, true); });
    models::stop_if_left();
    return result;
}

estimator::RefreshReport CycleResidual::update_active_set(estimator::ActiveSet& active, const VectorXd& theta,
                                                          const std::vector<VectorXd>&, const VectorXd& scales) const {
    const std::vector<PeriodicOrbit> solved = orbits(active, theta);
    estimator::RefreshReport report;
    const auto rejected_before = static_cast<int>(std::exchange(rejected_at_start(active), 0.0));
    std::vector<estimator::BlockLayout>& layout = active.layout.edit();
    for (std::size_t b = 0; b < layout.size(); ++b) {
        // A multiplier that has become 0, or no longer is.
        if (solved[b].status != OrbitStatus::converged) continue;
        const bool before = has_multipliers(active, b);
        const bool anything = lay_out(active, b, solved[b]);
        report.changed = report.changed || (layout[b].active && before != has_multipliers(active, b));
        if (anything) continue;
        report.lost += layout[b].active ? 1 : 0;
        layout[b].active = false;
    }
    std::vector<double> size(layout.size(), std::numeric_limits<double>::infinity());
    std::vector<double> active_sizes;
    for (std::size_t b = 0; b < layout.size(); ++b) {
        if (solved[b].status != OrbitStatus::converged) {
            if (layout[b].active) {
                layout[b].active = false;
                ++report.lost;
            }
            continue;
        }
        if (layout[b].group.empty()) continue;
        if (const auto e = residual(active, b, solved[b], theta)) size[b] = mean_square(active, b, *e, scales);
        if (layout[b].active) active_sizes.push_back(size[b]);
    }
    const double limit = active_sizes.empty() ? std::numeric_limits<double>::infinity()
                                              : options_.gate * models::upper_median(active_sizes);
    for (std::size_t b = 0; b < layout.size(); ++b) {
        if (solved[b].status != OrbitStatus::converged) continue;
        const bool plausible = std::isfinite(size[b]) && size[b] <= limit;
        if (layout[b].active && !plausible) {
            layout[b].active = false;
            ++report.rejected;
        } else if (!layout[b].active && plausible && taken_back(active, b) < most_returns) {
            layout[b].active = true;
            ++taken_back(active, b);
            ++report.added;
        }
        // The start of the next solution; a rejected cycle keeps its own, for it may have slid onto a wrong orbit.
        if (plausible) keep(active, b, solved[b], theta);
    }
    report.changed = report.changed || report.lost + report.rejected + report.added > 0;
    for (std::size_t b = 0; shared_ > 0 && b < layout.size(); ++b)
        report.changed =
            report.changed || (targets_.targets[b].common.size() > 0 &&
                               layout[b].active != (active.memory[memory_parts * b + gain_part].size() > 0));
    link(active);
    // What is inactive at the start is counted as lost.
    report.rejected += rejected_before;
    report.lost -= rejected_before;
    return report;
}

}  // namespace orbid::orbits

#include "orbits/cycle_residuals/cycle_residual.hpp"

#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include <tbb/parallel_for.h>

#include "models/arithmetic/cholesky_factor.hpp"
#include "models/arithmetic/median.hpp"
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
      scale_(state_scale(map_, cycles)),
      groups_(target_groups(map_, "cycles", options.targets)) {
    if (!(options.maximum_move > 0.0)) throw std::invalid_argument("CycleResidual: maximum_move must be > 0");
    if (!(options.gate > 1.0)) throw std::invalid_argument("CycleResidual: gate must be > 1");
    refuse_if(!start_nodes.empty() && start_nodes.size() != cycles.size(),
              "CycleResidual: {} start nodes for {} cycles", start_nodes.size(), cycles.size());
    for (const CycleTarget& target : targets_.targets) {
        layout_.emplace_back().label = target.label;
        Known known;
        known.nodes = target.nodes;
        if (!start_nodes.empty() && start_nodes[target.cycle].size() > 0) {
            const MatrixXd& nodes = start_nodes[target.cycle];
            refuse_if(
                nodes.rows() != target.points.rows() || nodes.cols() != target.points.cols() || !nodes.allFinite(),
                "CycleResidual: start nodes of {} must be finite and have the shape of its points", target.label);
            known.nodes = nodes;
        }
        known_.push_back(std::move(known));
    }
    // Solutions at the start give every later one a prediction to first order. A cycle without one keeps its guess.
    const std::vector<PeriodicOrbit> solved = orbits(start);
    for (std::size_t b = 0; b < solved.size(); ++b) {
        // A state of rest that is no isolated orbit (dry friction) has nothing that could be followed.
        const bool followed = targets_.targets[b].positions || solved[b].status == OrbitStatus::converged;
        layout_[b].active = lay_out(b, solved[b]) && followed;
        if (solved[b].status == OrbitStatus::converged) keep(b, solved[b], start);
    }
    if (!start_nodes.empty()) gate_start(solved, start);
}

void CycleResidual::gate_start(const std::vector<PeriodicOrbit>& solved, const VectorXd& start) {
    const VectorXd range = map_.points(scale_);
    // Mean squares in units of the cycle's own errors, and of the ranges. The start is not the optimum: what it is off
    // by moves the best measured cycles by thousands of their errors, but all of them by about the same share of the
    // range.
    std::vector<double> size(layout_.size(), 0.0);
    std::vector<double> distance(layout_.size(), 0.0);
    std::vector<double> sizes;
    std::vector<double> distances;
    for (std::size_t b = 0; b < layout_.size(); ++b) {
        const CycleTarget& target = targets_.targets[b];
        if (!layout_[b].active || !target.positions || solved[b].status != OrbitStatus::converged) continue;
        const auto e = residual(b, solved[b], start);
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
    for (std::size_t b = 0; b < layout_.size(); ++b) {
        if (size[b] <= largest_size || distance[b] <= largest_distance) continue;
        layout_[b].active = false;
        ++rejected_at_start_;
    }
}

void CycleResidual::keep(std::size_t block, const PeriodicOrbit& orbit, const VectorXd& theta) {
    Known& known = known_[block];
    known.nodes = map_.points(orbit.points);
    known.theta = theta;
    known.sensitivities = binding_.spread(map_.points(orbit.sensitivities));
    known.rotation = orbit.rotation;
}

std::vector<VectorXd> CycleResidual::initial_latents() const {
    return std::vector<VectorXd>(layout_.size());
}

PeriodicOrbit CycleResidual::solve(std::size_t block, const VectorXd& theta, bool derivatives) const {
    const Known& known = known_[block];
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

std::vector<estimator::BlockValue> CycleResidual::evaluate(const VectorXd& theta, const std::vector<VectorXd>&,
                                                           bool derivatives) const {
    const VectorXd values = binding_.values(theta);
    return evaluate_blocks(*system_, values, layout_, [&](std::size_t b, estimator::BlockValue& block) {
        const PeriodicOrbit orbit = solve(b, theta, derivatives);
        if (orbit.status != OrbitStatus::converged) return false;
        const auto readings = reading_(map_.points(orbit.points), values, binding_.parameter, derivatives);
        if (!readings) return false;
        const auto e = residual(b, orbit, *readings);
        if (!e) return false;
        block.e = *e;
        block.e_z.resize(e->size(), 0);
        if (!derivatives) return true;
        const auto slope = derivative(b, orbit, *readings, values);
        if (!slope) return false;
        block.e_theta = *slope;
        return true;
    });
}

std::vector<PeriodicOrbit> CycleResidual::orbits(const VectorXd& theta) const {
    std::vector<PeriodicOrbit> result(layout_.size());
    tbb::parallel_for(std::size_t{0}, layout_.size(), [&](std::size_t b) { result[b] = solve(b, theta, true); });
    return result;
}

double CycleResidual::mean_square(std::size_t block, const VectorXd& e, const VectorXd& scales) const {
    VectorXd whitened = e;
    for (Index i = 0; i < e.size(); ++i)
        whitened(i) /= scales(layout_[block].group[static_cast<std::size_t>(i)]);
    const MatrixXd& shape = layout_[block].shape;
    if (shape.size() > 0) models::CholeskyFactor(shape).solve_lower_in_place(whitened);
    return whitened.squaredNorm() / static_cast<double>(e.size());
}

estimator::RefreshReport CycleResidual::update_active_set(const VectorXd& theta, const std::vector<VectorXd>&,
                                                          const VectorXd& scales) {
    const std::vector<PeriodicOrbit> solved = orbits(theta);
    estimator::RefreshReport report;
    const int rejected_before = std::exchange(rejected_at_start_, 0);
    for (std::size_t b = 0; b < layout_.size(); ++b) {
        // A multiplier that has become 0, or no longer is.
        if (solved[b].status != OrbitStatus::converged) continue;
        const bool before = known_[b].multipliers;
        const bool anything = lay_out(b, solved[b]);
        report.changed = report.changed || (layout_[b].active && before != known_[b].multipliers);
        if (anything) continue;
        report.lost += layout_[b].active ? 1 : 0;
        layout_[b].active = false;
    }
    std::vector<double> size(layout_.size(), std::numeric_limits<double>::infinity());
    std::vector<double> active_sizes;
    for (std::size_t b = 0; b < layout_.size(); ++b) {
        if (solved[b].status != OrbitStatus::converged) {
            if (layout_[b].active) {
                layout_[b].active = false;
                ++report.lost;
            }
            continue;
        }
        if (layout_[b].group.empty()) continue;
        if (const auto e = residual(b, solved[b], theta)) size[b] = mean_square(b, *e, scales);
        if (layout_[b].active) active_sizes.push_back(size[b]);
    }
    const double limit = active_sizes.empty() ? std::numeric_limits<double>::infinity()
                                              : options_.gate * models::upper_median(active_sizes);
    for (std::size_t b = 0; b < layout_.size(); ++b) {
        if (solved[b].status != OrbitStatus::converged) continue;
        const bool plausible = std::isfinite(size[b]) && size[b] <= limit;
        if (layout_[b].active && !plausible) {
            layout_[b].active = false;
            ++report.rejected;
        } else if (!layout_[b].active && plausible && known_[b].taken_back < most_returns) {
            layout_[b].active = true;
            ++known_[b].taken_back;
            ++report.added;
        }
        // The start of the next solution; a rejected cycle keeps its own, for it may have slid onto a wrong orbit.
        if (plausible) keep(b, solved[b], theta);
    }
    report.changed = report.changed || report.lost + report.rejected + report.added > 0;
    // What is inactive at the start is counted as lost.
    report.rejected += rejected_before;
    report.lost -= rejected_before;
    return report;
}

}  // namespace orbid::orbits

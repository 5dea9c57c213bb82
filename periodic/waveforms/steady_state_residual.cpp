#include "periodic/waveforms/steady_state_residual.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <utility>

#include "models/definition/parameter.hpp"
#include "models/system/left_loop.hpp"
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/solution/solve_orbit.hpp"

namespace orbid::periodic {

using estimator::BlockStatus;
using estimator::BlockValue;

namespace {

/// A lost orbit is reactivated at most this often, so that updates of the active set end.
constexpr int most_returns = 2;
/// Minimisations that are repeated only because solutions had moved far from where they were known.
constexpr int most_anchorings = 3;
/// An orbit that is found at the end belongs to a block if it leaves less than this share of its variance: there the
/// model describes the others already.
constexpr double alike = 0.25;
/// Steps along the line to a theta that is too far for one: at most 2^4.
constexpr int most_halvings = 4;

/// Whether a block has an orbit to be followed. Without free parameters its place is empty all the same.
template <class Known>
bool has_orbit(const Known& known) {
    return known.place.size() > 0 || (known.status == OrbitStatus::converged && known.orbit.points.size() > 0);
}

}  // namespace

BlockValue SteadyStateResidual::failed() {
    BlockValue value;
    value.status = BlockStatus::failed;
    return value;
}

void SteadyStateResidual::add_block(const models::ParameterBinding& binding, estimator::BlockLayout layout) {
    bindings_.push_back(binding);
    initial_.layout.edit().push_back(std::move(layout));
}

void SteadyStateResidual::find_starts(const VectorXd& theta) {
    initial_.latents.resize(bindings_.size());
    initial_.memory.resize(memory_parts * bindings_.size());
    tbb::parallel_for(std::size_t{0}, bindings_.size(), [&](std::size_t b) {
        const Known known = find_start(b, theta).known;
        remember(initial_, b, known);
        initial_.layout.edit()[b].active = known.status == OrbitStatus::converged;
    });
    models::stop_if_left();
    initial_.memory.push_back(VectorXd::Zero(2));  // anchorings, and what a derived residual counts
}

bool SteadyStateResidual::in_domain(const VectorXd& values) const {
    for (Index i = 0; i < values.size(); ++i)
        if (!models::contains(system_->parameters()[static_cast<std::size_t>(i)].domain, values(i))) return false;
    return true;
}

FollowedOrbit SteadyStateResidual::spread(std::size_t block, FollowedOrbit orbit) const {
    const models::ParameterBinding& binding = bindings_[block];
    orbit.sensitivities = binding.spread(orbit.sensitivities);
    if (orbit.time_sensitivities.size() > 0) orbit.time_sensitivities = binding.spread(orbit.time_sensitivities);
    return orbit;
}

void SteadyStateResidual::keep(Known& known, std::size_t block, FollowedOrbit orbit, const VectorXd& place) const {
    known.orbit = spread(block, std::move(orbit));
    known.place = place;
}

VectorXd SteadyStateResidual::moved_place(const Known& known, const VectorXd& theta) {
    VectorXd place = known.place;
    place.head(theta.size()) = theta;
    return place;
}

FollowedOrbit SteadyStateResidual::solve_near(std::size_t block, const Known& from, const VectorXd& theta,
                                              bool derivatives) const {
    const models::ParameterBinding& binding = bindings_[block];
    const VectorXd values = binding.values(theta);
    PeriodicOrbit none;
    none.status = OrbitStatus::not_simulated;
    if (!theta.allFinite() || !in_domain(values)) return none;
    StartingSolution start;
    start.points = from.orbit.points;
    start.rotation = from.orbit.rotation;
    const bool autonomous = system_->kind() == models::Kind::autonomous;
    if (autonomous) {
        start.points = from.orbit.points.leftCols(1);
        start.time = from.orbit.time;
    }
    if (from.place.size() > 0) {
        const VectorXd step = theta - from.place;
        const VectorXd move = from.orbit.sensitivities.topRows(start.points.size()) * step;
        start.points += move.reshaped(start.points.rows(), start.points.cols());
        // T by its logarithm, as Newton's method moves it: it stays positive.
        if (autonomous) start.time *= std::exp(from.orbit.time_sensitivities.dot(step) / from.orbit.time);
    }
    if (!start.points.allFinite() || !(start.time < std::numeric_limits<double>::infinity())) return none;
    ShootingOptions options;
    options.scale = from.scale;
    options.maximum_distance = following_.maximum_move;
    options.flow = following_.flow;
    const std::vector<Index> no_parameters;
    return solve_orbit(*system_, values, start, derivatives ? binding.parameter : no_parameters, options);
}

FollowedOrbit SteadyStateResidual::solve(std::size_t block, const Known& known, const VectorXd& place,
                                         bool derivatives) const {
    FollowedOrbit orbit = solve_near(block, known, place, derivatives);
    if (orbit.status == OrbitStatus::converged) return orbit;
    // A step that is too long for one prediction is divided into shorter ones.
    for (int halvings = 1; halvings <= most_halvings; ++halvings) {
        const int steps = 1 << halvings;
        Known from = known;
        bool reached = true;
        for (int i = 1; i < steps && reached; ++i) {
            const double share = static_cast<double>(i) / steps;
            const VectorXd between = known.place + share * (place - known.place);
            FollowedOrbit next = solve_near(block, from, between, true);
            reached = next.status == OrbitStatus::converged;
            if (!reached) break;
            keep(from, block, std::move(next), between);
        }
        if (!reached) continue;
        FollowedOrbit last = solve_near(block, from, place, derivatives);
        if (last.status == OrbitStatus::converged) return last;
    }
    return orbit;
}

std::vector<BlockValue> SteadyStateResidual::evaluate(const estimator::ActiveSet& active, const VectorXd& theta,
                                                      const std::vector<VectorXd>& latents, bool derivatives) const {
    assert(latents.size() == bindings_.size());
    std::vector<BlockValue> values(bindings_.size());
    tbb::parallel_for(std::size_t{0}, bindings_.size(), [&](std::size_t b) {
        values[b] = failed();
        if (!active.layout[b].active) {
            values[b] = {};
        } else if (latents[b].allFinite()) {
            const Known from = known(active, b);
            const FollowedOrbit orbit = solve(b, from, placed(b, theta, latents[b]), derivatives);
            if (orbit.status == OrbitStatus::converged)
                values[b] = value(b, from, orbit, theta, latents[b], derivatives);
        }
    });
    models::stop_if_left();
    return values;
}

std::vector<PeriodicOrbit> SteadyStateResidual::solutions(const estimator::ActiveSet& active,
                                                          const VectorXd& theta) const {
    std::vector<PeriodicOrbit> orbits(bindings_.size());
    tbb::parallel_for(std::size_t{0}, bindings_.size(), [&](std::size_t b) {
        const Known from = known(active, b);
        orbits[b].status = from.status;
        if (has_orbit(from)) orbits[b] = solve(b, from, moved_place(from, theta), false);
    });
    models::stop_if_left();
    return orbits;
}

/// Seeks the orbits of lost blocks anew, from what was measured, once per block. @return how many are back
int SteadyStateResidual::seek_again(estimator::ActiveSet& active, const VectorXd& theta) const {
    std::vector<std::size_t> lost;
    for (std::size_t b = 0; b < bindings_.size(); ++b)
        if (!active.layout[b].active && !known(active, b).sought_again && in_domain(bindings_[b].values(theta)))
            lost.push_back(b);
    if (lost.empty()) return 0;
    std::vector<estimator::BlockLayout>& layout = active.layout.edit();
    tbb::parallel_for(std::size_t{0}, lost.size(), [&](std::size_t i) {
        const std::size_t b = lost[i];
        const Known before = known(active, b);
        auto [after, misfit] = find_start(b, theta);
        after.taken_back = before.taken_back;
        if (after.status != OrbitStatus::converged || !(misfit < alike)) after = before;
        after.sought_again = true;
        remember(active, b, after);
        layout[b].active = has_orbit(after) && after.place.head(theta.size()) == theta;
    });
    models::stop_if_left();
    return static_cast<int>(std::count_if(lost.begin(), lost.end(), [&](std::size_t b) { return layout[b].active; }));
}

estimator::RefreshReport SteadyStateResidual::update_active_set(estimator::ActiveSet& active, const VectorXd& theta,
                                                                const std::vector<VectorXd>& latents,
                                                                const VectorXd& /*scales*/) const {
    std::vector<FollowedOrbit> solved(bindings_.size());
    std::vector<VectorXd> places(bindings_.size());
    tbb::parallel_for(std::size_t{0}, bindings_.size(), [&](std::size_t b) {
        const Known from = known(active, b);
        if (!has_orbit(from)) return;
        places[b] = active.layout[b].active ? placed(b, theta, latents[b]) : moved_place(from, theta);
        solved[b] = solve(b, from, places[b], true);
    });
    models::stop_if_left();
    estimator::RefreshReport report;
    bool far = false;
    for (std::size_t b = 0; b < bindings_.size(); ++b) {
        Known last = known(active, b);
        if (!has_orbit(last)) continue;
        const bool there = solved[b].status == OrbitStatus::converged;
        if (there) {
            const VectorXd move = (solved[b].points.col(0) - last.orbit.points.col(0)).cwiseQuotient(last.scale);
            far = far || !(move.cwiseAbs().maxCoeff() <= following_.maximum_move);
            keep(last, b, solved[b], places[b]);
        }
        estimator::BlockLayout& layout = active.layout.edit()[b];
        if (layout.active && !there) {
            layout.active = false;
            ++report.lost;
        } else if (!layout.active && there && last.taken_back < most_returns) {
            layout.active = true;
            ++last.taken_back;
            ++report.added;
        }
        remember(active, b, last);
    }
    // Solutions that were predicted from afar are predicted from here once more: near the end of a branch the
    // predictions alone may have stopped those steps.
    double& anchorings = active.memory.back()[0];
    const bool again = far && anchorings < most_anchorings;
    if (again) ++anchorings;
    report.changed = report.lost + report.added > 0 || again;
    if (!report.changed) {
        report.added = seek_again(active, theta);
        report.changed = report.added > 0;
    }
    return report;
}

}  // namespace orbid::periodic

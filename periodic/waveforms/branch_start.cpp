// Which orbit of the model a measured motion is: at the start, and where an estimate would end.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <oneapi/tbb/parallel_for.h>

#include "models/system/left_loop.hpp"
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/orbit/full_turn.hpp"
#include "periodic/solution/solve_orbit.hpp"
#include "periodic/waveforms/branch_residual.hpp"

namespace orbid::periodic {
namespace {

/// Rounds in which all orbits are sought anew, so that an estimate ends.
constexpr double most_rounds = 4;
/// An orbit resembles a motion where their measures differ by less than half, on root mean square. A motion near a fold
/// that the model has not reached has no orbit, and is not to be taken for another one.
constexpr double resembling = 0.25;
/// Measures are compared with their own size, but for those below this share of the channel's: means near 0.
constexpr double smallest_share = 0.1;
/// Another orbit is taken where it leaves less than this share of the misfit: at a fold two orbits differ by little.
constexpr double better = 1.0 - 1e-9;
constexpr double rounded_misfit = 1e-20;  // by which those of exact data differ

}  // namespace

double BranchResidual::misfit(std::size_t block, const estimator::BlockValue& value) const {
    const auto measured = sources(block);
    double sum = 0.0;
    for (std::size_t r = 0; r < measured.size(); ++r) {
        const auto c = static_cast<Index>(measured[r]);
        const double e = value.e(static_cast<Index>(r));
        const double own = orbits_[block].values(c) * orbits_[block].values(c);
        const double mean = spread_(c) / static_cast<double>(orbits_.size());
        // A measure that is 0 everywhere has no size to be compared with.
        const double size = std::max(own, smallest_share * smallest_share * mean);
        if (size > 0.0) sum += e * e / size;
    }
    return sum / static_cast<double>(measured.size());
}

SteadyStateResidual::FoundStart BranchResidual::find_start(std::size_t b, const VectorXd& theta) const {
    return best_of(b, {orbits_[b].starts, orbits_[b].starts_at}, theta);
}

int BranchResidual::seek_again(estimator::ActiveSet& active, const VectorXd& theta) const {
    double& rounds = active.memory.back()[1];
    if (!options_.starts || rounds >= most_rounds) return 0;
    ++rounds;
    const auto starts = options_.starts(theta);
    std::vector<unsigned char> changed(orbits_.size(), 0);
    tbb::parallel_for(std::size_t{0}, std::min(starts.size(), orbits_.size()), [&](std::size_t b) {
        const Known before = known(active, b);
        FoundStart found = best_of(b, starts[b], theta);
        if (found.known.status != OrbitStatus::converged) return;
        double present = std::numeric_limits<double>::infinity();
        if (active.layout[b].active) {
            const VectorXd place = moved_place(before, theta);
            const FollowedOrbit orbit = solve(b, before, place, false);
            if (orbit.status == OrbitStatus::converged) {
                const estimator::BlockValue errors = value(b, before, orbit, theta, latents_of(place), false);
                if (errors.status == estimator::BlockStatus::ok) present = misfit(b, errors);
            }
        }
        // The same orbit again has the same misfit, to rounding.
        if (!(found.misfit < better * present - rounded_misfit)) return;
        found.known.taken_back = before.taken_back;
        remember(active, b, found.known);
        active.layout.edit()[b].active = true;
        changed[b] = 1;
    });
    models::stop_if_left();
    return static_cast<int>(std::count(changed.begin(), changed.end(), 1));
}

SteadyStateResidual::FoundStart BranchResidual::best_of(std::size_t b, const BranchStarts& starts,
                                                        const VectorXd& theta) const {
    FoundStart best;
    best.misfit = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < starts.orbits.size(); ++i) {
        const double own = moves_parameter() ? orbits_[b].binding.base(options_.parameter) : 0.0;
        const double at = i < starts.at.size() ? starts.at[i] : own;
        FoundStart found = started_from(b, starts.orbits[i], at, theta);
        if (found.known.status != OrbitStatus::converged) continue;
        if (found.misfit < resembling && found.misfit < best.misfit) best = std::move(found);
    }
    return best;
}

SteadyStateResidual::FoundStart BranchResidual::started_from(std::size_t b, const StartingSolution& start, double at,
                                                             const VectorXd& theta) const {
    const VectorXd values = values_at(b, theta, at);
    ShootingOptions options;
    options.flow = following().flow;
    options.maximum_distance = std::numeric_limits<double>::infinity();
    FoundStart found;
    Known& known = found.known;
    if (moves_parameter()) {
        // At the given parameter; next to a fold, where none need exist there, across the motion's own direction.
        known.orbit = across(values, {start, at, {MatrixXd(), 0.0, 1.0}}, {}, {});
        if (known.orbit.status != OrbitStatus::converged)
            known.orbit = across(values, {start, at, {start.points, 0.0, 0.0}}, {}, {});
    } else {
        known.orbit = FollowedOrbit(solve_orbit(*system_, values, start, {}, options));
    }
    known.status = known.orbit.status;
    if (known.status != OrbitStatus::converged) return found;
    known.status = OrbitStatus::not_simulated;
    // The size of the orbit, as its points show it: never 0.
    const MatrixXd& points = known.orbit.points;
    known.scale = points.rowwise().norm() / std::sqrt(static_cast<double>(points.cols()));
    const VectorXd there = values_at(b, theta, known.orbit.parameter);
    const OrbitReadings along(*system_, there, known.orbit, {}, std::nullopt, following().flow);
    if (!along.simulated()) return found;
    for (Index i = 0; i < points.rows(); ++i) {
        const auto range = along.measure(OrbitMeasure::half_range, i);
        const auto rms = along.measure(OrbitMeasure::rms, i);
        const double size = range ? std::max(range->value, rms->value) : full_turn;
        known.scale(i) = size > 0.0 ? size : 1.0;
    }
    VectorXd place = theta;
    if (moves_parameter()) {
        known.origin = origin_at(known.orbit, known.scale);
        const Place own = place_of(b, known.origin, there, known.orbit, {});
        if (!own.found) return found;
        place.conservativeResize(theta.size() + 1);
        place.tail(1)(0) = own.value;
    } else {
        known.orbit.sensitivities.resize(0, 0);
    }
    FollowedOrbit solved = solve_near(b, known, place, true);
    known.status = solved.status;
    if (known.status != OrbitStatus::converged) return found;
    const estimator::BlockValue errors = value(b, known, solved, theta, latents_of(place), false);
    if (errors.status != estimator::BlockStatus::ok)
        known.status = OrbitStatus::not_simulated;
    else
        found.misfit = misfit(b, errors);
    keep(known, b, std::move(solved), place);
    return found;
}

}  // namespace orbid::periodic

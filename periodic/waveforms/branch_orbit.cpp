// The orbits of measured motions on their branch: at the measured parameter, or where that has an error at a place on
// the branch, the latent state of the motion.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "periodic/branches/orbit_across.hpp"
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/orbit/winding_number.hpp"
#include "periodic/waveforms/branch_residual.hpp"

namespace orbid::periodic {
namespace {

using Eigen::RowVectorXd;

/// Newton's steps along the branch to the wanted place.
constexpr int most_steps_along = 12;
/// They end when the place is met to this share of itself or of one: far below what the flow leaves of the measures.
constexpr double met = 1e-11;
/// or, where it no longer comes nearer, to this one.
constexpr double nearly_met = 1e-8;

}  // namespace

/// Where a step in the columns of an orbit's sensitivities leads. The direction is that of the last column.
BranchResidual::PredictedOrbit BranchResidual::predicted_orbit(const FollowedOrbit& from, const VectorXd& step,
                                                               bool autonomous) {
    PredictedOrbit predicted;
    StartingSolution& start = predicted.start;
    start.points = autonomous ? MatrixXd(from.points.leftCols(1)) : from.points;
    start.rotation = from.rotation;
    const MatrixXd slopes = from.sensitivities.topRows(start.points.size());
    start.points += (slopes * step).reshaped(start.points.rows(), start.points.cols());
    // T by its logarithm, as Newton's method moves it: it stays positive.
    if (autonomous) start.time = from.time * std::exp(from.time_sensitivities.dot(step) / from.time);
    predicted.parameter = from.parameter + from.parameter_sensitivities.dot(step);
    predicted.direction.points = slopes.rightCols(1).reshaped(start.points.rows(), start.points.cols());
    if (autonomous) predicted.direction.ln_time = from.time_sensitivities.tail(1)(0) / from.time;
    predicted.direction.parameter = from.parameter_sensitivities.tail(1)(0);
    return predicted;
}

VectorXd BranchResidual::latents_of(const VectorXd& place) const {
    return place.tail(moves_parameter() ? 1 : 0);
}

VectorXd BranchResidual::placed(std::size_t /*block*/, const VectorXd& theta, const VectorXd& latents) const {
    VectorXd place(theta.size() + latents.size());
    place << theta, latents;
    return place;
}

VectorXd BranchResidual::starting_latents(std::size_t block, const Known& known) const {
    if (!moves_parameter()) return {};
    if (known.place.size() > 0) return latents_of(known.place);
    const bool measure = system_->kind() == models::Kind::autonomous;
    return VectorXd::Constant(1, measure ? orbits_[block].values(static_cast<Index>(sources(block).front())) : 0.0);
}

PhaseOrigin BranchResidual::origin_at(const FollowedOrbit& orbit, const VectorXd& scale) const {
    PhaseOrigin origin;
    if (system_->kind() == models::Kind::autonomous) return origin;
    const VectorXd units = scale.replicate(orbit.points.cols(), 1);
    const VectorXd tangent = orbit.sensitivities.rightCols(1).cwiseQuotient(units);
    origin.point = orbit.points.reshaped();
    origin.normal = tangent.cwiseQuotient(units) / std::max(tangent.norm(), std::numeric_limits<double>::min());
    return origin;
}

BranchResidual::Place BranchResidual::place_of(std::size_t block, const PhaseOrigin& origin, const VectorXd& values,
                                               const FollowedOrbit& orbit, std::span<const Index> free) const {
    Place place;
    if (system_->kind() == models::Kind::autonomous) {
        const Measures own = measured(block, values, orbit, free, true);
        place.found = own.found;
        if (!own.found) return place;
        place.value = own.values(0);
        place.slope = own.slopes.row(0);
        return place;
    }
    const MatrixXd from = origin.point.reshaped(orbit.points.rows(), orbit.points.cols());
    const MatrixXd moved = wrapped_angles(orbit.points - from, angle_coordinates(*system_));
    place.found = true;
    place.value = origin.normal.dot(moved.reshaped());
    place.slope = origin.normal.transpose() * orbit.sensitivities;
    return place;
}

FollowedOrbit BranchResidual::spread(std::size_t block, FollowedOrbit orbit) const {
    if (!moves_parameter()) return SteadyStateResidual::spread(block, std::move(orbit));
    const models::ParameterBinding& own = binding(block);
    const auto with_latent = [&](const MatrixXd& columns) {
        MatrixXd all(columns.rows(), own.estimated_count + 1);
        all << own.spread(columns.leftCols(columns.cols() - 1)), columns.rightCols(1);
        return all;
    };
    orbit.sensitivities = with_latent(orbit.sensitivities);
    orbit.parameter_sensitivities = with_latent(orbit.parameter_sensitivities);
    if (orbit.time_sensitivities.size() > 0) orbit.time_sensitivities = with_latent(orbit.time_sensitivities);
    return orbit;
}

VectorXd BranchResidual::values_at(std::size_t block, const VectorXd& theta, double parameter) const {
    VectorXd values = binding(block).values(theta);
    if (moves_parameter()) values(options_.parameter) = parameter;
    return values;
}

FollowedOrbit BranchResidual::across(const VectorXd& values, const PredictedOrbit& predicted,
                                     std::span<const Index> free, const VectorXd& scale) const {
    ShootingOptions options;
    options.flow = following().flow;
    options.scale = scale;
    const double range = std::max(std::abs(values(options_.parameter)), options_.parameter_sd);
    BranchOrbit found =
        orbit_across(*system_, values, options_.parameter, range, predicted.start, predicted.direction, free, options);
    FollowedOrbit orbit(std::move(found.orbit));
    orbit.parameter = found.parameter;
    orbit.parameter_sensitivities = std::move(found.parameter_sensitivities);
    return orbit;
}

BranchResidual::Measures BranchResidual::measured(std::size_t block, const VectorXd& values, const FollowedOrbit& orbit,
                                                  std::span<const Index> free, bool derivatives) const {
    using Free = std::optional<std::span<const Index>>;
    std::vector<Index> all(free.begin(), free.end());
    if (moves_parameter()) all.push_back(options_.parameter);
    const OrbitReadings along(*system_, values, orbit, options_.sensor, derivatives ? Free(all) : Free(),
                              following().flow, options_.readings);
    Measures result;
    if (!along.simulated()) return result;
    // The parameter's own share, the orbit held: what the flow between its points makes of it.
    std::optional<OrbitReadings> held;
    if (derivatives && moves_parameter()) {
        PeriodicOrbit fixed = orbit;
        fixed.sensitivities = MatrixXd::Zero(orbit.sensitivities.rows(), 1);
        if (orbit.time_sensitivities.size() > 0) fixed.time_sensitivities = RowVectorXd::Zero(1);
        held.emplace(*system_, values, fixed, options_.sensor, Free(std::span<const Index>(&options_.parameter, 1)),
                     following().flow, options_.readings);
        if (!held->simulated()) return result;
    }
    const auto channels = sources(block);
    result.values.resize(std::ssize(channels));
    result.slopes.resize(derivatives ? result.values.size() : 0, std::ssize(all));
    for (std::size_t r = 0; r < channels.size(); ++r) {
        const BranchChannel& channel = options_.channels[channels[r]];
        const auto predicted = along.measure(channel.measure, channel.coordinate);
        if (!predicted) return result;
        const auto row = static_cast<Index>(r);
        result.values(row) = predicted->value;
        if (!derivatives) continue;
        result.slopes.row(row) = predicted->by_parameters;
        if (!held) continue;
        const double own = held->measure(channel.measure, channel.coordinate)->by_parameters(0);
        result.slopes.row(row) += own * orbit.parameter_sensitivities;
        result.slopes(row, std::ssize(free)) -= own;
    }
    result.found = true;
    return result;
}

FollowedOrbit BranchResidual::by_place(std::size_t block, const PhaseOrigin& origin, const VectorXd& values,
                                       FollowedOrbit orbit) const {
    const Place own = place_of(block, origin, values, orbit, binding(block).parameter);
    if (!own.found) {
        orbit.status = OrbitStatus::not_simulated;
        return orbit;
    }
    const Index f = own.slope.size() - 1;
    // ds = (dz - z_theta dtheta) / z_s, s along the branch
    const auto exchanged = [&](auto& columns) {
        columns.col(f) /= own.slope(f);
        columns.leftCols(f) -= columns.col(f) * own.slope.head(f);
    };
    exchanged(orbit.sensitivities);
    exchanged(orbit.parameter_sensitivities);
    if (orbit.time_sensitivities.size() > 0) exchanged(orbit.time_sensitivities);
    if (!orbit.sensitivities.allFinite()) orbit.status = OrbitStatus::singular;
    return orbit;
}

FollowedOrbit BranchResidual::solve_near(std::size_t block, const Known& from, const VectorXd& place,
                                         bool derivatives) const {
    if (!moves_parameter()) return SteadyStateResidual::solve_near(block, from, place, derivatives);
    FollowedOrbit none;
    none.status = OrbitStatus::not_simulated;
    if (!place.allFinite()) return none;
    const VectorXd theta = place.head(binding(block).estimated_count);
    // Where an orbit was just found, nothing but the tangent is known. It is the last column, too.
    VectorXd step = VectorXd::Zero(from.orbit.sensitivities.cols());
    if (from.place.size() > 0) step = place - from.place;
    const bool autonomous = system_->kind() == models::Kind::autonomous;
    const PredictedOrbit predicted = predicted_orbit(from.orbit, step, autonomous);
    FollowedOrbit orbit = at_place(block, from, theta, latents_of(place)(0), predicted);
    if (orbit.status != OrbitStatus::converged) return orbit;
    const MatrixXd move = orbit.points.leftCols(predicted.start.points.cols()) - predicted.start.points;
    orbit.distance = (move.array().colwise() / from.scale.array()).abs().maxCoeff();
    if (!(orbit.distance <= following().maximum_move)) orbit.status = OrbitStatus::other_orbit;
    if (!derivatives || orbit.status != OrbitStatus::converged) return orbit;
    const PredictedOrbit here = predicted_orbit(orbit, VectorXd::Zero(1), autonomous);
    orbit = across(values_at(block, theta, here.parameter), here, binding(block).parameter, from.scale);
    if (orbit.status != OrbitStatus::converged) return orbit;
    return by_place(block, from.origin, values_at(block, theta, orbit.parameter), std::move(orbit));
}

FollowedOrbit BranchResidual::at_place(std::size_t block, const Known& from, const VectorXd& theta, double wanted,
                                       PredictedOrbit predicted) const {
    FollowedOrbit orbit;
    orbit.status = OrbitStatus::not_simulated;
    double before = std::numeric_limits<double>::infinity();
    for (int i = 0; i < most_steps_along; ++i) {
        const VectorXd values = values_at(block, theta, predicted.parameter);
        const bool finite = predicted.start.points.allFinite() && std::isfinite(predicted.start.time);
        orbit.status = OrbitStatus::not_simulated;
        if (!finite || !in_domain(values)) return orbit;
        orbit = across(values, predicted, {}, from.scale);
        if (orbit.status != OrbitStatus::converged) return orbit;
        const Place own = place_of(block, from.origin, values_at(block, theta, orbit.parameter), orbit, {});
        orbit.status = OrbitStatus::not_simulated;
        if (!own.found) return orbit;
        const double unit = system_->kind() == models::Kind::autonomous ? std::abs(wanted) : 1.0;
        const double off = std::abs(wanted - own.value) / unit;
        if (off <= met || (off < nearly_met && off >= 0.1 * before)) {
            orbit.status = OrbitStatus::converged;
            return orbit;
        }
        before = off;
        const VectorXd along = VectorXd::Constant(1, (wanted - own.value) / own.slope(0));
        predicted = predicted_orbit(orbit, along, system_->kind() == models::Kind::autonomous);
    }
    orbit.status = OrbitStatus::iteration_limit;
    return orbit;
}

}  // namespace orbid::periodic

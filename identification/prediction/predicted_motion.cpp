#include "identification/prediction/predicted_motion.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include <oneapi/tbb/parallel_for.h>

#include "estimator/interface/not_finite.hpp"
#include "identification/problem/fitted_branch.hpp"
#include "models/system/stopped.hpp"
#include "periodic/solution/multiple_shooting.hpp"

namespace orbid::identification {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using periodic::OrbitPlace;
using periodic::OrbitStatus;
using periodic::PeriodicOrbit;

using estimator::nan_value;
/// Local error of the flows of draws: a millionth of what a band of a thousandth needs.
constexpr double draw_tolerance = 1e-9;

/// sqrt(j C j^T) of every quantity; nan without a covariance.
VectorXd delta_sds(const MatrixXd& slopes, const MatrixXd& covariance) {
    if (slopes.cols() == 0) return VectorXd::Zero(slopes.rows());
    if (covariance.size() == 0) return VectorXd::Constant(slopes.rows(), nan_value);
    return (slopes * covariance).cwiseProduct(slopes).rowwise().sum().cwiseSqrt();
}

bool is_stable(const PeriodicOrbit& orbit) {
    return orbit.multipliers.empty() || std::abs(orbit.multipliers.front()) <= 1.0;
}

/// Solves a start that is meant as it is.
PeriodicOrbit solved(const models::System& system, const VectorXd& values, const periodic::StartingSolution& start,
                     std::span<const Index> free) {
    periodic::ShootingOptions solver;
    solver.maximum_distance = std::numeric_limits<double>::infinity();
    return periodic::solve_multiple_shooting(system, values, start, free, solver);
}

/// The indices of parameters in which two vectors differ.
std::vector<Index> differences(const VectorXd& a, const VectorXd& b) {
    std::vector<Index> different;
    for (Index i = 0; i < a.size(); ++i)
        if (a(i) != b(i)) different.push_back(i);
    return different;
}

/// @param orbit  at the estimate, of which all draws start
periodic::OrbitPathOptions draw_options(const models::System& system, const VectorXd& values, double phase,
                                        const PeriodicOrbit& orbit) {
    periodic::OrbitPathOptions options;
    options.solver.scale = periodic::orbit_size(system, values, phase, orbit);
    options.solver.flow.relative_tolerance = options.solver.flow.absolute_tolerance = draw_tolerance;
    return options;
}

/// The loop over draws: done in any order, each into its own slot.
template <class Body>
void over_draws(const ParameterDraws& draws, const PredictionRun& run, const Body& body) {
    std::atomic<std::size_t> done{0};
    tbb::parallel_for(Index{0}, draws.values.cols(), [&](Index k) {
        if (run.interrupted && run.interrupted()) throw models::Stopped();
        body(k);
        const std::size_t so_far = ++done;
        if (run.progress) run.progress(so_far);
    });
}

/// The columns of those that were found.
MatrixXd joined(const std::vector<VectorXd>& columns, Index rows) {
    Index count = 0;
    for (const VectorXd& column : columns)
        count += column.size() > 0 ? 1 : 0;
    MatrixXd all(rows, count);
    Index k = 0;
    for (const VectorXd& column : columns)
        if (column.size() > 0) all.col(k++) = column;
    return all;
}

/// A draw with the values that are held.
VectorXd drawn_values(const ParameterDraws& draws, Index k, const std::vector<Index>& free, VectorXd values) {
    for (const Index parameter : free)
        values(parameter) = draws.values(parameter, k);
    return values;
}

}  // namespace

PredictedOrbit predict_orbit(const models::System& system, const ParameterPosterior& posterior,
                             const ParameterDraws& draws, const periodic::StartingSolution& start, const VectorXd& to,
                             std::vector<periodic::OrbitReading> readings, const PredictionRun& run) {
    PredictedOrbit predicted;
    const OrbitPlace place{start.phase, start.section};
    const std::vector<Index> moved = differences(posterior.values, to);
    const FreeCovariance free = free_covariance(posterior, moved);
    PeriodicOrbit orbit = solved(system, posterior.values, start, moved);
    if (orbit.status == OrbitStatus::converged && !moved.empty())
        orbit = periodic::orbit_along(system, posterior.values, orbit, to, moved, place);
    if (orbit.status == OrbitStatus::converged) orbit = solved(system, to, place.start(system, orbit), free.parameters);
    predicted.orbit = orbit;
    if (orbit.status != OrbitStatus::converged) return predicted;
    const bool named = system.kind() != models::Kind::autonomous || start.section;
    predicted.layout = {system.dimension(), std::move(readings), named ? orbit.points.size() : 0};
    const auto quantities = [&](const VectorXd& values, const PeriodicOrbit& one) {
        return quantities_of(predicted.layout, one,
                             amplitude_with_readings(system, values, start.phase, one, predicted.layout.readings));
    };
    const VectorXd value = quantities(to, orbit);
    const VectorXd delta =
        delta_sds(quantity_slopes(predicted.layout, system, to, start.phase, orbit, free.parameters), free.covariance);
    if (draws.values.cols() == 0) {
        predicted.quantities = by_delta_method(value, delta);
        return predicted;
    }
    std::vector<VectorXd> found(static_cast<std::size_t>(draws.values.cols()));
    std::vector<unsigned char> stable(found.size(), 0);
    const auto options = draw_options(system, to, start.phase, orbit);
    over_draws(draws, run, [&](Index k) {
        const VectorXd values = drawn_values(draws, k, free.parameters, to);
        const auto one = periodic::orbit_along(system, to, orbit, values, free.parameters, place, options);
        if (one.status != OrbitStatus::converged) return;
        found[static_cast<std::size_t>(k)] = quantities(values, one);
        stable[static_cast<std::size_t>(k)] = is_stable(one) ? 1 : 0;
    });
    predicted.quantities = summarised(value, joined(found, value.size()), delta);
    predicted.quantities.stable = static_cast<double>(std::count(stable.begin(), stable.end(), 1)) /
                                  static_cast<double>(predicted.quantities.found);
    return predicted;
}

namespace {

/// One followed branch: the first of the diagram with its quantities.
std::optional<std::pair<periodic::Branch, MatrixXd>> followed_with(const models::System& system, const VectorXd& values,
                                                                   const periodic::StartingSolution& start,
                                                                   const periodic::ContinuationOptions& options,
                                                                   const MotionQuantities& layout,
                                                                   OrbitStatus& status) {
    auto diagram = periodic::follow_branches(system, values, start, options);
    status = diagram.start_status;
    if (diagram.branches.empty() || diagram.branches.front().points.size() < 2) return std::nullopt;
    periodic::Branch& branch = diagram.branches.front();
    if (!layout.readings.empty()) add_amplitudes(system, values, layout.readings, branch);
    MatrixXd quantities(layout.count(), std::ssize(branch.points));
    for (Index k = 0; k < quantities.cols(); ++k) {
        const periodic::BranchPoint& point = branch.points[static_cast<std::size_t>(k)];
        quantities.col(k) = quantities_of(layout, point.orbit, point.amplitude);
    }
    return std::pair{std::move(branch), std::move(quantities)};
}

/// The sds of the delta method along the branch at the estimate.
std::vector<VectorXd> delta_along(const models::System& system, const PredictedBranch& predicted,
                                  const VectorXd& values, const OrbitPlace& place, const FreeCovariance& free) {
    std::vector<VectorXd> sds(predicted.branch.points.size());
    tbb::parallel_for(std::size_t{0}, sds.size(), [&](std::size_t k) {
        const periodic::BranchPoint& point = predicted.branch.points[k];
        sds[k] = VectorXd::Constant(predicted.layout.count(), nan_value);
        VectorXd own = values;
        own(predicted.branch.parameter) = point.parameter;
        const auto orbit = solved(system, own, place.start(system, point.orbit), free.parameters);
        // At a fold the derivatives are infinite.
        if (orbit.status != OrbitStatus::converged || !orbit.sensitivities.allFinite()) return;
        sds[k] = delta_sds(quantity_slopes(predicted.layout, system, own, place.phase, orbit, free.parameters),
                           free.covariance);
    });
    return sds;
}

void add_marks(PredictedBranch& predicted, const BranchSheets& estimate) {
    for (const BranchMark& mark : estimate.marks()) {
        std::vector<double> drawn;
        for (const BranchSheets& one : predicted.draws)
            for (const BranchMark& other : one.marks())
                if (other.name == mark.name) drawn.push_back(other.parameter);
        const MatrixXd row = Eigen::Map<const Eigen::RowVectorXd>(drawn.data(), std::ssize(drawn));
        predicted.marks.push_back(
            {mark, summarised(VectorXd::Constant(1, mark.parameter), row, VectorXd::Constant(1, nan_value))});
    }
}

}  // namespace

BranchSheets sheets_of(const PredictedBranch& predicted, double start) {
    MatrixXd quantities(predicted.layout.count(), std::ssize(predicted.branch.points));
    for (Index k = 0; k < quantities.cols(); ++k)
        quantities.col(k) = predicted.points[static_cast<std::size_t>(k)].value;
    return {predicted.branch, quantities, start, predicted.near};
}

PredictedQuantities quantities_at(const PredictedBranch& predicted, const BranchSheets& estimate, int sheet,
                                  double parameter) {
    const Index count = predicted.layout.count();
    const auto value = estimate.at(sheet, parameter, 1);
    std::vector<VectorXd> found;
    std::size_t stable = 0;
    for (const BranchSheets& one : predicted.draws) {
        auto drawn = one.at(sheet, parameter, 1);
        if (!drawn) continue;
        if (!((*drawn)(predicted.layout.multiplier()) > 1.0)) ++stable;
        found.push_back(std::move(*drawn));
    }
    if (!value && found.empty()) return {};
    const VectorXd none = VectorXd::Constant(count, nan_value);
    auto all = summarised(value ? *value : none, joined(found, count), none);
    if (!found.empty()) all.stable = static_cast<double>(stable) / static_cast<double>(found.size());
    return all;
}

PredictedQuantities delta_at(const PredictedBranch& predicted, int sheet, double parameter, const VectorXd& value) {
    VectorXd sd = VectorXd::Constant(value.size(), nan_value);
    const auto& points = predicted.branch.points;
    for (std::size_t k = 0; k + 1 < points.size(); ++k) {
        const double a = points[k].parameter, b = points[k + 1].parameter;
        if (!((a - parameter) * (b - parameter) <= 0.0) || a == b) continue;
        if (predicted.sheets[k] != sheet && predicted.sheets[k + 1] != sheet) continue;
        const double share = (parameter - a) / (b - a);
        sd = (1.0 - share) * predicted.points[k].delta_sd + share * predicted.points[k + 1].delta_sd;
        break;
    }
    return by_delta_method(value, sd);
}

PredictedBranch predict_branch(const models::System& system, const ParameterPosterior& posterior,
                               const ParameterDraws& draws, const periodic::StartingSolution& start,
                               periodic::ContinuationOptions options, std::vector<periodic::OrbitReading> readings,
                               const PredictionRun& run) {
    PredictedBranch predicted;
    predicted.layout = {system.dimension(), std::move(readings), 0};
    options.switch_doublings = options.switch_symmetry = false;
    options.maximum_branches = 1;
    const VectorXd& values = posterior.values;
    const double at = values(options.parameter);
    const OrbitPlace place{start.phase, start.section};
    const FreeCovariance free = free_covariance(posterior, {options.parameter});
    const PeriodicOrbit first = solved(system, values, start, free.parameters);
    predicted.start = first.status;
    if (first.status != OrbitStatus::converged) return predicted;
    predicted.near = first.points.col(0);
    auto own = followed_with(system, values, place.start(system, first), options, predicted.layout, predicted.start);
    if (!own) return predicted;
    predicted.branch = std::move(own->first);
    for (Index k = 0; k < own->second.cols(); ++k)
        predicted.points.push_back({own->second.col(k), {}, {}, {}, {}, 0, nan_value});
    const BranchSheets estimate = sheets_of(predicted, at);
    for (std::size_t k = 0; k < predicted.points.size(); ++k)
        predicted.sheets.push_back(estimate.sheet_of(k));
    const auto delta = delta_along(system, predicted, values, place, free);

    options.solver.flow.relative_tolerance = options.solver.flow.absolute_tolerance = draw_tolerance;
    const auto path = draw_options(system, values, place.phase, first);
    std::vector<std::optional<BranchSheets>> drawn(static_cast<std::size_t>(draws.values.cols()));
    over_draws(draws, run, [&](Index k) {
        const VectorXd here = drawn_values(draws, k, free.parameters, values);
        const auto orbit = periodic::orbit_along(system, values, first, here, free.parameters, place, path);
        if (orbit.status != OrbitStatus::converged) return;
        OrbitStatus status{};
        const auto one = followed_with(system, here, place.start(system, orbit), options, predicted.layout, status);
        if (one) drawn[static_cast<std::size_t>(k)].emplace(one->first, one->second, at, orbit.points.col(0));
    });
    for (auto& one : drawn)
        if (one) predicted.draws.push_back(std::move(*one));
    predicted.followed = predicted.draws.size();
    tbb::parallel_for(std::size_t{0}, predicted.points.size(), [&](std::size_t k) {
        const VectorXd value = predicted.points[k].value;
        if (draws.values.cols() == 0) {
            predicted.points[k] = by_delta_method(value, delta[k]);
            return;
        }
        PredictedQuantities all =
            quantities_at(predicted, estimate, predicted.sheets[k], predicted.branch.points[k].parameter);
        // The point itself, not the interpolation that agrees with it to rounding.
        all.value = value;
        all.delta_sd = delta[k];
        predicted.points[k] = std::move(all);
    });
    add_marks(predicted, estimate);
    return predicted;
}

}  // namespace orbid::identification

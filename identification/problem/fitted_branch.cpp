#include "identification/problem/fitted_branch.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include <oneapi/tbb/parallel_for.h>

#include "identification/problem/problem_branch.hpp"

namespace orbid::identification {

namespace {

using Eigen::Index;
using Eigen::VectorXd;
using periodic::OrbitMeasure;

constexpr std::pair<OrbitMeasure, VectorXd periodic::OrbitAmplitude::*> amplitude_members[] = {
    {OrbitMeasure::maximum, &periodic::OrbitAmplitude::maximum},
    {OrbitMeasure::minimum, &periodic::OrbitAmplitude::minimum},
    {OrbitMeasure::mean, &periodic::OrbitAmplitude::mean},
    {OrbitMeasure::half_range, &periodic::OrbitAmplitude::half_range},
    {OrbitMeasure::rms, &periodic::OrbitAmplitude::rms}};

/// Whether `x` lies between two neighbours, within half their distance and a hundredth of its size: it may have a
/// maximum between them.
bool near_both(double x, double a, double b) {
    const double spare = 0.5 * std::abs(b - a) + 1e-2 * std::abs(x);
    return x >= std::min(a, b) - spare && x <= std::max(a, b) + spare;
}

/// Whether an orbit at this value of the parameter is one of the branch.
bool lies_on(const periodic::Branch& branch, double at, double time, const periodic::OrbitAmplitude& amplitude) {
    for (std::size_t k = 1; k < branch.points.size(); ++k) {
        const periodic::BranchPoint& a = branch.points[k - 1];
        const periodic::BranchPoint& b = branch.points[k];
        if (!near_both(at, a.parameter, b.parameter) || !near_both(time, a.orbit.time, b.orbit.time)) continue;
        bool same = a.amplitude.half_range.size() > 0 && b.amplitude.half_range.size() > 0;
        for (Index i = 0; same && i < amplitude.half_range.size(); ++i) {
            const double x = amplitude.half_range(i);
            // An angle that turns around has none.
            same = !std::isfinite(x) || near_both(x, a.amplitude.half_range(i), b.amplitude.half_range(i));
        }
        if (same) return true;
    }
    return false;
}

periodic::StartingSolution start_from(const periodic::PeriodicOrbit& orbit, bool autonomous) {
    periodic::StartingSolution start;
    start.points = orbit.points;
    start.rotation = orbit.rotation;
    if (autonomous) {
        start.points = orbit.points.leftCols(1);
        start.time = orbit.time;
    }
    return start;
}

}  // namespace

periodic::OrbitAmplitude amplitude_by_readings(const models::System& system, const VectorXd& values,
                                               const periodic::PeriodicOrbit& orbit,
                                               const std::vector<periodic::OrbitReading>& readings) {
    const Index count = system.dimension() + std::ssize(readings);
    periodic::OrbitAmplitude amplitude;
    const periodic::OrbitReadings along(system, values, orbit, {}, std::nullopt, models::FlowOptions{1e-12, 1e-12},
                                        readings);
    if (!along.simulated()) return amplitude;
    for (const auto& [measure, member] : amplitude_members) {
        amplitude.*member = VectorXd::Constant(count, std::numeric_limits<double>::quiet_NaN());
        for (Index i = 0; i < count; ++i)
            if (const auto value = along.measure(measure, i)) (amplitude.*member)(i) = value->value;
    }
    return amplitude;
}

void add_amplitudes(const models::System& system, VectorXd values, const std::vector<periodic::OrbitReading>& readings,
                    periodic::Branch& branch) {
    tbb::parallel_for(std::size_t{0}, branch.points.size(), [&](std::size_t k) {
        VectorXd own = values;
        own(branch.parameter) = branch.points[k].parameter;
        branch.points[k].amplitude = amplitude_by_readings(system, own, branch.points[k].orbit, readings);
    });
}

std::vector<FittedPiece> fitted_branch(const IdentificationProblem& problem, const EstimateSetup& setup,
                                       const periodic::BranchResidual& residual, const estimator::ActiveSet& active,
                                       const VectorXd& theta) {
    const models::System& system = *problem.system;
    const bool autonomous = system.kind() == models::Kind::autonomous;
    BranchChoice asked = *problem.branch;
    VectorXd values = setup.model.values(theta);
    std::vector<FittedPiece> pieces;
    const auto follow = [&](const std::string& from) {
        auto diagram = followed_branch(system, asked, values);
        if (diagram.branches.empty()) return;
        add_amplitudes(system, values, asked.readings, diagram.branches.front());
        pieces.push_back({from, std::move(diagram.branches.front())});
    };
    follow("the start");
    const auto solutions = residual.solutions(active, theta);
    for (std::size_t b = 0; b < solutions.size(); ++b) {
        const periodic::PeriodicOrbit& orbit = solutions[b];
        if (orbit.status != periodic::OrbitStatus::converged || !active.layout[b].active) continue;
        values = residual.binding(b).values(theta);
        const double at = values(asked.parameter);
        const auto amplitude = amplitude_by_readings(system, values, orbit, asked.readings);
        if (std::any_of(pieces.begin(), pieces.end(),
                        [&](const FittedPiece& piece) { return lies_on(piece.branch, at, orbit.time, amplitude); }))
            continue;
        asked.start = start_from(orbit, autonomous);
        follow(residual.orbits()[b].label);
    }
    return pieces;
}

}  // namespace orbid::identification

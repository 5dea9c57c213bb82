#include "identification/problem/problem_branch.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "orbits/records/data_error.hpp"
#include "periodic/branches/continuation.hpp"

namespace orbid::identification {

namespace {

using Eigen::Index;

/// A branch is followed beyond the measured motions by this share of their range: it may turn back in a fold there.
constexpr double margin = 0.5;
/// Points of an estimate's branch, at most.
constexpr std::size_t most_points = 2000;

/// The range over which the branch is followed, within the domain of the parameter.
std::pair<double, double> followed_range(const models::System& system, const Eigen::VectorXd& values,
                                         const BranchChoice& asked) {
    const double own = values[asked.parameter];
    double lower = std::min(own, asked.at.minCoeff());
    double upper = std::max(own, asked.at.maxCoeff());
    if (asked.range) return {std::min(lower, asked.range->first), std::max(upper, asked.range->second)};
    const double beyond = upper > lower ? margin * (upper - lower) : margin * std::max(std::abs(own), 1.0);
    if (system.parameters()[static_cast<std::size_t>(asked.parameter)].domain != models::Domain::real)
        lower = std::max(lower - beyond, 0.5 * lower);
    else
        lower -= beyond;
    return {lower, upper + beyond};
}

/// @param values  the problem's; `theta` are those of an estimate.
periodic::BifurcationDiagram followed(const models::System& system, const Eigen::VectorXd& values,
                                      const BranchChoice& asked, const Eigen::VectorXd& theta) {
    periodic::ContinuationOptions options;
    options.parameter = asked.parameter;
    std::tie(options.lower, options.upper) = followed_range(system, values, asked);
    options.switch_doublings = options.switch_symmetry = false;
    options.maximum_points = most_points;
    options.solver.maximum_distance = std::numeric_limits<double>::infinity();
    return periodic::follow_branches(system, theta, asked.start, options);
}

/// The orbit between two neighbours on a branch where the parameter has this value, about.
periodic::StartingSolution between(const periodic::BranchPoint& a, const periodic::BranchPoint& b, double at,
                                   bool autonomous) {
    const double share = b.parameter != a.parameter ? (at - a.parameter) / (b.parameter - a.parameter) : 0.0;
    const periodic::PeriodicOrbit& near = share < 0.5 ? a.orbit : b.orbit;
    periodic::StartingSolution start;
    start.points = near.points;
    start.rotation = near.rotation;
    // Points of an orbit of a limit cycle are as many as the solver needed, and not at the same shares: the first one
    // and T are an orbit's start.
    if (autonomous) {
        start.points = near.points.leftCols(1);
        start.time = near.time;
    } else if (a.orbit.points.cols() == b.orbit.points.cols()) {
        start.points = a.orbit.points + share * (b.orbit.points - a.orbit.points);
    }
    return start;
}

periodic::BranchStarts starts_at(const periodic::BifurcationDiagram& diagram, double at, bool autonomous) {
    periodic::BranchStarts starts;
    for (const periodic::Branch& branch : diagram.branches)
        for (std::size_t k = 1; k < branch.points.size(); ++k) {
            const periodic::BranchPoint& a = branch.points[k - 1];
            const periodic::BranchPoint& b = branch.points[k];
            if ((a.parameter - at) * (b.parameter - at) > 0.0) continue;
            starts.orbits.push_back(between(a, b, at, autonomous));
            starts.at.push_back(at);
        }
    return starts;
}

/// The same for a parameter with an error. Where the branch does not reach it: its nearest orbit, a fold as a rule.
periodic::BranchStarts starts_near(const periodic::BifurcationDiagram& diagram, double at, bool autonomous) {
    periodic::BranchStarts starts = starts_at(diagram, at, autonomous);
    if (!starts.orbits.empty()) return starts;
    for (const periodic::Branch& branch : diagram.branches) {
        const auto near = std::min_element(
            branch.points.begin(), branch.points.end(),
            [&](const auto& a, const auto& b) { return std::abs(a.parameter - at) < std::abs(b.parameter - at); });
        if (near == branch.points.end()) continue;
        starts.orbits.push_back(between(*near, *near, near->parameter, autonomous));
        starts.at.push_back(near->parameter);
    }
    return starts;
}

}  // namespace

periodic::BifurcationDiagram followed_branch(const models::System& system, const BranchChoice& asked,
                                             const Eigen::VectorXd& values) {
    return followed(system, values, asked, values);
}

std::vector<std::string> add_branch(const IdentificationProblem& problem, const EstimateSetup& setup,
                                    const Eigen::VectorXd& start, std::unique_ptr<periodic::BranchResidual>& residual) {
    if (!problem.branch) return {};
    const BranchChoice& asked = *problem.branch;
    const std::string parameter(problem.parameter(asked.parameter).name);
    const auto diagram = followed(*problem.system, problem.values, asked, setup.model.values(start));
    if (diagram.branches.empty())
        throw orbits::DataError(
            fmt::format("branch: no branch begins at the given orbit: {}", periodic::name(diagram.start_status)));
    const bool autonomous = problem.system->kind() == models::Kind::autonomous;
    std::vector<periodic::MeasuredOrbit> orbits;
    for (Index i = 0; i < asked.at.size(); ++i) {
        periodic::MeasuredOrbit orbit;
        orbit.label = fmt::format("{} = {}", parameter, asked.at[i]);
        orbit.binding = setup.model;
        orbit.binding.base[asked.parameter] = asked.at[i];
        orbit.values = asked.values.col(i);
        if (asked.deviations.size() > 0) orbit.deviations = asked.deviations.col(i);
        periodic::BranchStarts starts = (asked.at_sd > 0.0 ? starts_near : starts_at)(diagram, asked.at[i], autonomous);
        orbit.starts = std::move(starts.orbits);
        orbit.starts_at = std::move(starts.at);
        orbits.push_back(std::move(orbit));
    }
    periodic::BranchOptions options;
    for (const BranchChoice::Channel& channel : asked.channels)
        options.channels.push_back({channel.measure, channel.errors.coordinate, channel.errors.scale,
                                    channel.errors.distribution, channel.errors.floor,
                                    !channel.errors.sd_column.empty()});
    options.parameter = asked.parameter;
    options.parameter_sd = asked.at_sd;
    options.start = start;
    options.readings = asked.readings;
    options.starts = [system = problem.system, values = problem.values, binding = setup.model,
                      asked](const Eigen::VectorXd& theta) {
        const auto there = followed(*system, values, asked, binding.values(theta));
        const auto found = asked.at_sd > 0.0 ? starts_near : starts_at;
        std::vector<periodic::BranchStarts> starts;
        for (const double at : asked.at)
            starts.push_back(found(there, at, system->kind() == models::Kind::autonomous));
        return starts;
    };
    residual = std::make_unique<periodic::BranchResidual>(problem.system, std::move(orbits), std::move(options));
    std::vector<std::string> lost;
    for (std::size_t b = 0; b < residual->orbits().size(); ++b) {
        if (residual->start_status(b) == periodic::OrbitStatus::converged) continue;
        const periodic::MeasuredOrbit& orbit = residual->orbits()[b];
        lost.push_back(fmt::format("branch, {}: {}", orbit.label,
                                   orbit.starts.empty() ? "the branch at the start does not reach it"
                                                        : "no orbit of the branch at the start resembles it"));
    }
    if (lost.size() == residual->orbits().size())
        throw orbits::DataError(fmt::format("{}; start the parameters nearer", fmt::join(lost, "; ")));
    return lost;
}

}  // namespace orbid::identification

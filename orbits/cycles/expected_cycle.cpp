#include "orbits/cycles/expected_cycle.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <span>
#include <stdexcept>

#include "models/system/argument_check.hpp"
#include "orbits/records/refusal.hpp"
#include "periodic/search/orbit_search.hpp"
#include "periodic/solution/solve_orbit.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Model coordinate of each coordinate of the series.
std::vector<Index> model_coordinates(const Series& series, const models::System& system) {
    std::vector<Index> result;
    for (const SeriesCoordinate& coordinate : series.coordinates) {
        result.push_back(system.coordinate_index(coordinate.name));
        refuse_record_if(result.back() < 0, "harvest: the series has a coordinate '{}', the model none of this name",
                         coordinate.name);
    }
    return result;
}

void validate_search(const models::System& system, const VectorXd& theta, const ModelGuidedSearchOptions& options) {
    models::check_parameters(system, theta);
    models::check_free(system, options.free);
    models::check_sensor(system, options.sensor);
    const auto free = static_cast<Index>(options.free.size());
    const bool exact = options.covariance.size() == 0;
    refuse_if(!exact && !(options.covariance.rows() == free && options.covariance.cols() == free),
              "harvest: covariance has shape ({}, {}), there are {} free parameters", options.covariance.rows(),
              options.covariance.cols(), free);
    refuse_if(!options.covariance.allFinite() || (!exact && !(options.covariance.diagonal().minCoeff() >= 0.0)),
              "harvest: the covariance of theta must be finite, its variances >= 0");
    if (options.maximum_orbits == 0) throw std::invalid_argument("harvest: maximum_orbits must be > 0, got 0");
    const bool autonomous = system.kind() == models::Kind::autonomous;
    refuse_if(autonomous && !options.section, "harvest: model {} is autonomous: the plane of the section must be named",
              system.name());
    refuse_if(!autonomous && options.section,
              "harvest: model {} is not autonomous: its sections are no crossings of a plane", system.name());
}

// The orbits, the least unstable of each period first.
std::vector<periodic::PeriodicOrbit> orbits_of(const models::System& system, const VectorXd& theta,
                                               const ModelGuidedSearchOptions& options) {
    periodic::OrbitSearchOptions search;
    search.periods = options.search.periods;
    std::sort(search.periods.begin(), search.periods.end());
    search.periods.erase(std::unique(search.periods.begin(), search.periods.end()), search.periods.end());
    search.phase = options.phase;
    search.section = options.section;
    search.points = options.search_points;
    search.symmetry = options.search.symmetry_signs.has_value();
    // The last resort: it found 0 of 493 orbits of the pendulum, for a quarter of the time.
    search.stabilised = false;
    periodic::OrbitSearch found = search_orbits(system, theta, search);
    std::map<int, std::vector<periodic::PeriodicOrbit>> by_period;
    for (std::size_t i = 0; i < found.orbits.size(); ++i) {
        const periodic::FoundOrbit& one = found.orbits[i];
        if (search.symmetry && one.mirror >= 0 && one.mirror < static_cast<int>(i)) continue;
        // Every fixed point of a map is at rest; of a flow the orbit is a state of rest.
        const bool rests = system.kind() != models::Kind::map && system.at_rest(one.orbit.points.col(0), theta);
        if (one.orbit.sticking || rests) continue;
        by_period[one.orbit.period].push_back(one.orbit);
    }
    std::vector<periodic::PeriodicOrbit> result;
    for (auto& [period, orbits] : by_period) {
        const auto instability = [](const periodic::PeriodicOrbit& orbit) {
            return orbit.multipliers.empty() ? 0.0 : std::abs(orbit.multipliers.front());
        };
        std::stable_sort(orbits.begin(), orbits.end(),
                         [&](const auto& a, const auto& b) { return instability(a) < instability(b); });
        orbits.resize(std::min(orbits.size(), options.maximum_orbits));
        result.insert(result.end(), orbits.begin(), orbits.end());
    }
    return result;
}

// Sensitivities of the points to the free parameters, shape (n p, f); empty where the orbit is lost.
MatrixXd sensitivities(const models::System& system, const VectorXd& theta, const ModelGuidedSearchOptions& options,
                       const periodic::PeriodicOrbit& orbit) {
    if (options.free.empty()) return MatrixXd(orbit.points.size(), 0);
    periodic::StartingSolution start;
    start.points = orbit.points;
    start.rotation = orbit.rotation;
    start.phase = options.phase;
    start.section = options.section;
    const periodic::PeriodicOrbit solved = solve_orbit(system, theta, start, options.free);
    if (solved.status != periodic::OrbitStatus::converged) return {};
    return solved.sensitivities;
}

}  // namespace

std::vector<ExpectedCycle> expected_cycles(const Series& series, const SectionPoints& section,
                                           const models::System& system, const VectorXd& theta,
                                           const ModelGuidedSearchOptions& options) {
    validate_search(system, theta, options);
    const std::vector<Index> rows = model_coordinates(series, system);
    const auto n = static_cast<Index>(rows.size());
    const Index states = system.dimension(), directions = states + static_cast<Index>(options.free.size());
    std::vector<ExpectedCycle> result;
    for (const periodic::PeriodicOrbit& orbit : orbits_of(system, theta, options)) {
        const Index p = orbit.points.cols();
        const MatrixXd by_free = sensitivities(system, theta, options, orbit);
        if (by_free.rows() != states * p) continue;
        const std::vector<double> phases(static_cast<std::size_t>(p), options.phase);
        const models::ReadingResult read =
            system.readings(options.sensor, orbit.points, phases, theta, std::span<const Index>(options.free));
        if (read.status != models::FlowStatus::ok) continue;
        ExpectedCycle expected;
        expected.points.resize(n, p);
        expected.variance.resize(n * p);
        for (Index j = 0; j < p; ++j) {
            const auto slopes = read.derivatives.middleCols(j * directions, directions);
            const MatrixXd moved = slopes.leftCols(states) * by_free.middleRows(j * states, states) +
                                   slopes.rightCols(directions - states);
            for (Index i = 0; i < n; ++i) {
                const Index row = rows[static_cast<std::size_t>(i)];
                const double unit = section.scale()[i];
                expected.points(i, j) = section.wrapped(read.readings(row, j) / unit, i);
                expected.variance[j * n + i] =
                    options.covariance.size() == 0
                        ? 0.0
                        : moved.row(row).dot(options.covariance * moved.row(row).transpose()) / (unit * unit);
            }
        }
        if (expected.points.allFinite() && expected.variance.allFinite()) result.push_back(std::move(expected));
    }
    return result;
}

double distance_in_sds(const SectionPoints& section, const ExpectedCycle& expected, const MatrixXd& points,
                       const VectorXd& variance, Index shift) {
    const Index n = points.rows(), p = points.cols();
    double largest = 0.0;
    for (Index j = 0; j < p; ++j) {
        const Index other = (j + shift) % p;
        for (Index i = 0; i < n; ++i) {
            const double apart = section.difference(points(i, other), expected.points(i, j), i);
            largest =
                std::max(largest, std::abs(apart) / std::sqrt(variance[other * n + i] + expected.variance[j * n + i]));
        }
    }
    return largest;
}

double distance_in_sds(const SectionPoints& section, const ExpectedCycle& expected, const MatrixXd& points,
                       const VectorXd& variance) {
    double nearest = std::numeric_limits<double>::infinity();
    if (points.cols() != expected.points.cols()) return nearest;
    for (Index shift = 0; shift < points.cols(); ++shift)
        nearest = std::min(nearest, distance_in_sds(section, expected, points, variance, shift));
    if (!section.symmetric()) return nearest;
    const MatrixXd mirrored = section.signs().asDiagonal() * points;
    for (Index shift = 0; shift < points.cols(); ++shift)
        nearest = std::min(nearest, distance_in_sds(section, expected, mirrored, variance, shift));
    return nearest;
}

}  // namespace orbid::orbits

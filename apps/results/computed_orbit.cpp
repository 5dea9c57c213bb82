#include "apps/results/computed_orbit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace orbid::apps {

namespace {

using periodic::OrbitStatus;

std::string point_text(const Eigen::MatrixXd& points) {
    std::string text;
    for (Eigen::Index i = 0; points.cols() > 0 && i < points.rows(); ++i)
        text += fmt::format("{}{:.6g}", i == 0 ? "" : ", ", points(i, 0));
    return fmt::format("({})", text);
}

/// "an orbit of period 2 with rotation +1 through (2.97, 6.41), 0.3 of the scale from the start": the prime one.
std::string found_text(const periodic::PeriodicOrbit& orbit) {
    const int times = orbit.repeats;
    // Without points of a section only T is known.
    std::string text = orbit.period % times == 0
                           ? fmt::format("an orbit of period {}", orbit.period / times)
                           : fmt::format("an orbit that closes after {:.6g} s", orbit.time / times);
    if (!orbit.rotation.empty()) {
        std::vector<int> rotation = orbit.rotation;
        for (int& turns : rotation)
            turns /= times;
        text += fmt::format(" with rotation {}", rotation_text(rotation));
    }
    return text +
           fmt::format(" through {}, {:.2g} of the scale from the start", point_text(orbit.points), orbit.distance);
}

std::string still_open(double residual) {
    return std::isfinite(residual) ? fmt::format(", the closing error stays at {:.2g}", residual) : std::string();
}

}  // namespace

std::string_view ComputedOrbit::status() const {
    return computed ? periodic::name(orbit.status) : std::string_view("interrupted");
}

std::size_t ComputedOrbits::converged() const {
    return static_cast<std::size_t>(
        std::count_if(list.begin(), list.end(), [](const ComputedOrbit& orbit) { return orbit.converged(); }));
}

std::string orbit_message(const periodic::PeriodicOrbit& orbit, const std::vector<int>& asked) {
    switch (orbit.status) {
        case OrbitStatus::converged:
            return {};
        case OrbitStatus::other_orbit:
            if (!asked.empty() && asked != orbit.rotation)
                return fmt::format("none with the rotation {} asked for: {}", rotation_text(asked), found_text(orbit));
            return "farther than \"maximum_distance\": " + found_text(orbit);
        case OrbitStatus::shorter_period:
            return found_text(orbit);
        case OrbitStatus::equilibrium:
            return fmt::format("it does not move: an equilibrium at {}", point_text(orbit.points));
        case OrbitStatus::period_vanished:
            return "the time of the orbit went to zero: there is no orbit near the start, or it is too small";
        case OrbitStatus::singular:
            return fmt::format(
                "the linear system is singular: a fold, where two orbits meet and vanish, a crossing of branches, or "
                "one of "
                "a whole family of orbits (no damping){}; other parameters, or \"continuation\" from one of them, show "
                "it",
                still_open(orbit.residual));
        case OrbitStatus::no_progress:
            return fmt::format("no orbit near the start{}", still_open(orbit.residual));
        case OrbitStatus::iteration_limit:
            return fmt::format("not closed within the steps allowed{}", still_open(orbit.residual));
        case OrbitStatus::not_simulated:
            return "the motion cannot be followed from there";
    }
    return {};
}

void show_start(periodic::PeriodicOrbit& orbit, const Eigen::MatrixXd& start) {
    if (orbit.points.size() > 0) return;
    orbit.period = static_cast<int>(start.cols());
    orbit.points = start;
    orbit.residual = std::numeric_limits<double>::quiet_NaN();
}

std::string rotation_text(const std::vector<int>& rotation) {
    std::string out;
    for (const int turns : rotation)
        out += fmt::format("{}{:+d}", out.empty() ? "" : " ", turns);
    return out;
}

}  // namespace orbid::apps

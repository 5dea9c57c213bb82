#include "apps/program/starting/starting_orbit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include <fmt/format.h>

namespace orbid::apps {

namespace {

using Eigen::Index;
using Eigen::VectorXd;

/// Enough for any transient of the registry's models to end.
constexpr std::size_t transient_periods = 300;
constexpr double transient_s = 200.0;
/// Sections after it among which the nearest return is taken.
constexpr Index looked_at = 200;
/// Autonomous models: what is looked at after the transient, and how finely.
constexpr double looked_at_s = 100.0;
constexpr int samples = 2000;

/// Where an orbit of an autonomous model is looked for.
struct Plane {
    Index coordinate = 0;
    double value = 0.0;
};

struct Start {
    std::optional<Plane> plane;
    VectorXd point;
    bool simulated = false;  ///< false: the point is only a place to fill in
};

models::FlowOptions coarse() {
    models::FlowOptions options;
    options.relative_tolerance = options.absolute_tolerance = 1e-8;
    return options;
}

/// The point that comes back nearest to itself after one step; angles in (-pi, pi].
VectorXd nearest_return(const models::System& system, const Eigen::MatrixXd& sections) {
    const VectorXd range =
        (sections.rowwise().maxCoeff() - sections.rowwise().minCoeff()).cwiseMax(std::numeric_limits<double>::min());
    Index best = 0;
    double least = std::numeric_limits<double>::infinity();
    VectorXd step(sections.rows());
    const auto wrap_angles = [&](VectorXd& x) {
        for (Index i = 0; i < x.size(); ++i)
            if (system.coordinates()[static_cast<std::size_t>(i)].angle) x(i) = models::wrapped(x(i));
    };
    for (Index k = 0; k + 1 < sections.cols(); ++k) {
        step = sections.col(k + 1) - sections.col(k);
        wrap_angles(step);
        const double gap = step.cwiseQuotient(range).cwiseAbs().maxCoeff();
        if (!(gap < least)) continue;
        least = gap;
        best = k;
    }
    VectorXd point = sections.col(best);
    wrap_angles(point);
    return point;
}

Start end_of_sections(const models::System& system, const VectorXd& theta) {
    Start start;
    // What is usual in one model is out of reach in another (a stroke of 1 m).
    for (const double first : {1.0, 0.1, 0.01, 0.001}) {
        start.point = VectorXd::Constant(system.dimension(), first);
        const auto ensemble = system.ensemble(start.point, 0.0, transient_periods + looked_at, theta, coarse());
        const Eigen::MatrixXd& sections = ensemble.sections.front();
        if (ensemble.status.front() != models::FlowStatus::ok || !sections.allFinite()) continue;
        return {std::nullopt, nearest_return(system, sections.rightCols(looked_at)), true};
    }
    return start;
}

/// The first coordinate that is no angle and moves, cut in the middle of its range.
std::optional<Plane> plane_through(const models::System& system, const Eigen::MatrixXd& states) {
    for (Index i = 0; i < states.rows(); ++i) {
        if (system.coordinates()[static_cast<std::size_t>(i)].angle) continue;
        const double low = states.row(i).minCoeff();
        const double high = states.row(i).maxCoeff();
        if (!(high - low > 1e-3 * std::max(std::abs(high), std::abs(low)))) continue;
        // A value that reads well: two digits of the range.
        const double step = std::pow(10.0, std::floor(std::log10(high - low)) - 1.0);
        return Plane{i, step * std::round(0.5 * (low + high) / step) + 0.0};  // no -0
    }
    return std::nullopt;
}

Start crossing_of_plane(const models::System& system, const VectorXd& theta) {
    Start start{std::nullopt, VectorXd::Ones(system.dimension()), false};
    start.point(0) = 2.0;  // equal cells would stay equal for ever
    std::vector<double> instants;
    for (int k = 0; k <= samples; ++k)
        instants.push_back(transient_s + looked_at_s * k / samples);
    const auto flow = system.flow(start.point, 0.0, instants, theta, models::Clock::time, coarse());
    if (flow.status != models::FlowStatus::ok || !flow.states.allFinite()) return start;
    start.plane = plane_through(system, flow.states);
    if (!start.plane) return start;
    const models::Section section{VectorXd::Unit(system.dimension(), start.plane->coordinate), start.plane->value, 1};
    const auto crossing =
        system.crossings(flow.states.col(0), section, looked_at, looked_at_s, theta, std::nullopt, coarse());
    if (crossing.states.cols() < 2) return start;
    start.point = nearest_return(system, crossing.states);
    start.point(start.plane->coordinate) = start.plane->value;
    start.simulated = true;
    return start;
}

std::string state_text(const VectorXd& state, const std::optional<Plane>& plane) {
    std::string text;
    for (Index i = 0; i < state.size(); ++i) {
        // On the plane to the last bit; six digits are plenty for a guess.
        const bool exact = plane && plane->coordinate == i;
        text += fmt::format("{}{}", i == 0 ? "" : ", ",
                            exact ? fmt::format("{}", state(i)) : fmt::format("{:.6g}", state(i)));
    }
    return text;
}

std::string names(const models::System& system) {
    const auto table = system.coordinates();
    if (table.size() > 6) return fmt::format("{} ... {}", table.front().name, table.back().name);
    std::string text;
    for (const auto& coordinate : table)
        text += fmt::format("{}{}", text.empty() ? "" : ", ", coordinate.name);
    return text;
}

std::string section_line(const models::System& system, const Start& start) {
    if (system.kind() != models::Kind::autonomous) return {};
    const Plane plane = start.plane.value_or(Plane{});
    const double value = start.plane ? plane.value : start.point(plane.coordinate);
    return fmt::format(
        "  // Orbits are counted by their crossings of this plane, here where the coordinate rises (-1: falls).\n"
        "  \"section\": {{ \"coordinate\": \"{}\", \"value\": {}, \"direction\": 1 }},\n",
        system.coordinates()[static_cast<std::size_t>(plane.coordinate)].name, value);
}

std::string_view counted_in(const models::System& system) {
    switch (system.kind()) {
        case models::Kind::forced:
            return "periods of the forcing";
        case models::Kind::map:
            return "iterations";
        case models::Kind::autonomous:
            break;
    }
    return "crossings of the section";
}

std::string orbits_lines(const models::System& system, const Start& start) {
    return fmt::format(
        R"(    "orbits": [
      // One state [{}] per period, {}.
      {{ "period": 1, "points": [[{}]] }}
    ])",
        names(system),
        start.simulated ? "here the nearest return of a simulation: a guess, corrected by Newton's method"
                        : "a guess, to be replaced by a better one",
        state_text(start.point, start.plane));
}

/// The frequency of the forcing, or the first parameter whose default says something.
Index followed_parameter(const models::System& system) {
    if (const auto frequency = system.forcing_frequency()) return *frequency;
    const auto table = system.parameters();
    const auto found = std::find_if(table.begin(), table.end(), [](const auto& p) { return p.default_value != 0.0; });
    return found == table.end() ? 0 : static_cast<Index>(found - table.begin());
}

std::string continuation_lines(const models::System& system) {
    const auto& parameter = system.parameters()[static_cast<std::size_t>(followed_parameter(system))];
    // A fifth to both sides; from zero on where there is nothing to take a fifth of.
    const double width = 0.2 * std::abs(parameter.default_value);
    const double low = parameter.default_value - width;
    const double high = width > 0.0 ? parameter.default_value + width : 1.0;
    return fmt::format(
        R"(    "continuation": {{
      "parameter": "{}",                // followed from the orbit above, both ways, around folds
      "range": [{:.6g}, {:.6g}],                // must contain the value in "model"
      "maximum_period": 8,                // branches of doubled period are followed up to this one
      "points": 300                       // at most, per branch
    }})",
        parameter.name, low, high);
}

}  // namespace

std::string starting_periodic_block(const models::System& system, std::string_view task) {
    const VectorXd theta = system.default_parameters();
    const Start start =
        system.kind() == models::Kind::autonomous ? crossing_of_plane(system, theta) : end_of_sections(system, theta);
    std::string text = section_line(system, start) + "  \"periodic\": {\n";
    if (task == "search") {
        return text +
               fmt::format(
                   R"(    // All orbits of these periods, in {}, from recurrences of the model's own trajectories.
    "search": {{ "periods": [1, 2, 3], "points": 65536 }},
    "free": []                            // no derivatives with respect to parameters
  }}
)",
                   counted_in(system));
    }
    text += orbits_lines(system, start) + ",\n";
    if (task == "continuation") return text + continuation_lines(system) + "\n  }\n";
    return text +
           "    \"method\": \"multiple_shooting\",      // or finite_difference, collocation (smooth flows)\n"
           "    \"stability\": true                  // directions, and how the multipliers move with parameters\n"
           "  }\n";
}

}  // namespace orbid::apps

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace orbid::models::pendulum_friction_test {

namespace {

/// One flow of tests/reference/pendulum_friction.json: 36 digits, rounded here to doubles. Derivatives with respect to
/// the start and all nine parameters, at fixed phases.
struct ReferenceFlow {
    std::string name;
    Eigen::VectorXd theta;
    Eigen::Vector2d start;
    double phase = 0.0;
    std::vector<double> durations;
    std::size_t crossings = 0;  ///< velocity zeros arrived at, those that stick too
    std::size_t stickings = 0;
    Eigen::MatrixXd states;                               ///< shape (2, m)
    Eigen::MatrixXd sensitivities;                        ///< shape (2, 11 m)
    std::vector<Eigen::Index> second_directions;          ///< of the eleven; empty without second derivatives
    std::array<Eigen::MatrixXd, 2> second_derivatives{};  ///< at the last duration, of phi and of phi_dot

    /// Largest growth of a disturbance of the start: errors of single steps grow like it.
    double stretch() const {
        double largest = 1.0;
        for (Eigen::Index k = 0; k < states.cols(); ++k)
            largest = std::max(largest, sensitivities.middleCols<2>(11 * k).norm());
        return largest;
    }
};

double number(const nlohmann::json& text) {
    return std::stod(text.get<std::string>());
}

std::vector<ReferenceFlow> reference_flows(const System& system) {
    std::ifstream in(orbid::tests::source_folder() + "/tests/reference/pendulum_friction.json");
    const auto json = nlohmann::json::parse(in);
    std::vector<ReferenceFlow> flows;
    for (const auto& c : json["cases"]) {
        ReferenceFlow flow;
        flow.name = c["name"];
        flow.theta = system.default_parameters();
        flow.start << c["start"][0].get<double>(), c["start"][1].get<double>();
        flow.phase = c["phase"];
        flow.durations = c["durations"].get<std::vector<double>>();
        for (const auto& [name, value] : c["parameters"].items())
            flow.theta[system.parameter_index(name)] = value.get<double>();
        // A start that is held sticks without having arrived.
        bool arrives = flow.start[1] != 0.0 || c.contains("leaves_to");
        for (const std::string event : c["events"]) {
            if (event != "release" && arrives) ++flow.crossings;
            if (event == "stick") ++flow.stickings;
            arrives = true;
        }
        const auto m = static_cast<Eigen::Index>(flow.durations.size());
        flow.states.resize(2, m);
        flow.sensitivities.resize(2, 11 * m);
        for (Eigen::Index k = 0; k < m; ++k)
            for (Eigen::Index i = 0; i < 2; ++i) {
                flow.states(i, k) = number(c["states"][k][i]);
                for (Eigen::Index j = 0; j < 11; ++j)
                    flow.sensitivities(i, 11 * k + j) = number(c["sensitivities"][k][i][j]);
            }
        if (c.contains("second")) {
            for (const std::string name : c["second_directions"]) {
                const Eigen::Index coordinate = system.coordinate_index(name);
                flow.second_directions.push_back(coordinate >= 0 ? coordinate : 2 + system.parameter_index(name));
            }
            const auto d = static_cast<Eigen::Index>(flow.second_directions.size());
            for (std::size_t i = 0; i < 2; ++i) {
                flow.second_derivatives[i].resize(d, d);
                for (Eigen::Index a = 0; a < d; ++a)
                    for (Eigen::Index b = 0; b < d; ++b)
                        flow.second_derivatives[i](a, b) = number(c["second"][i][a][b]);
            }
        }
        flows.push_back(std::move(flow));
    }
    return flows;
}

constexpr std::array<Eigen::Index, 9> all_parameters{0, 1, 2, 3, 4, 5, 6, 7, 8};

/// Errors are taken relative to 1 + |value|, those of derivatives relative to 1 + the largest entry of their column.
struct Errors {
    double values = 0.0;
    double unstretched = 0.0;  ///< of values, over the largest growth of a disturbance on the way
    double derivatives = 0.0;

    void take(const Errors& other) {
        values = std::max(values, other.values);
        unstretched = std::max(unstretched, other.unstretched);
        derivatives = std::max(derivatives, other.derivatives);
    }
};

double error_of_columns(const Eigen::MatrixXd& computed, const Eigen::MatrixXd& exact) {
    double worst = 0.0;
    for (Eigen::Index j = 0; j < exact.cols(); ++j)
        worst = std::max(worst, (computed.col(j) - exact.col(j)).lpNorm<Eigen::Infinity>() /
                                    (1.0 + exact.col(j).lpNorm<Eigen::Infinity>()));
    return worst;
}

Errors errors_of(const FlowResult& flow, const ReferenceFlow& reference, const Eigen::MatrixXd& sensitivities) {
    REQUIRE(flow.status == FlowStatus::ok);
    CHECK(flow.crossings == reference.crossings);
    CHECK(flow.stickings == reference.stickings);
    REQUIRE((flow.states.allFinite() && flow.sensitivities.allFinite()));
    const double values =
        ((flow.states - reference.states).array().abs() / (1.0 + reference.states.array().abs())).maxCoeff();
    const double derivatives =
        flow.sensitivities.cols() > 0 ? error_of_columns(flow.sensitivities, sensitivities) : 0.0;
    return {values, values / reference.stretch(), derivatives};
}

/// Worst errors over all reference flows, with derivatives and without.
Errors worst_errors(double tolerance) {
    const auto system = make_system("parametric_pendulum");
    const FlowOptions options{.relative_tolerance = tolerance, .absolute_tolerance = tolerance};
    const auto flows = reference_flows(*system);
    REQUIRE(flows.size() == 12);
    Errors worst;
    for (const ReferenceFlow& r : flows) {
        CAPTURE(r.name, tolerance);
        worst.take(
            errors_of(system->flow(r.start, r.phase, r.durations, r.theta, Clock::phase, options), r, r.sensitivities));
        worst.take(errors_of(system->flow_with_sensitivities(r.start, r.phase, r.durations, r.theta, all_parameters,
                                                             Clock::phase, options),
                             r, r.sensitivities));
    }
    return worst;
}

/// One of the flows is held for a moment and hardly leaves: rounding of what it leaves by gives its derivatives errors
/// of 6e-15 to 3.4e-13, another one at each tolerance between 7e-16 and 3e-14 and with every build. Times four.
constexpr double rounding_of_derivatives = 1.3e-12;

}  // namespace

TEST_CASE("the pendulum across crossings and sticking agrees with 30 digits", "[models][reference]") {
    // Measured, then times ten. At the default tolerance 1e-12: values 2.3e-11 in a flow that stretches a disturbance
    // 730 times, at most 9.5e-13 in the others, 3.1e-14 of the stretching; derivatives 5.3e-12.
    const Errors usual = worst_errors(FlowOptions{}.relative_tolerance);
    CHECK(usual.values < 2.3e-10);
    CHECK(usual.unstretched < 3.1e-13);
    CHECK(usual.derivatives < 5.3e-11);
    // At the tightest, where errors still fall with the tolerance: 5.3e-14 and at most 3.1e-15, 3.9e-16.
    const Errors fine = worst_errors(1e-15);
    CHECK(fine.values < 5.3e-13);
    CHECK(fine.unstretched < 3.9e-15);
    CHECK(fine.derivatives < rounding_of_derivatives);
}

TEST_CASE("in time, too, the pendulum across crossings and sticking agrees with 30 digits", "[models][reference]") {
    // x(t) at a fixed time moves with omega by the phase that goes along: dx/domega + (f / omega) t.
    const auto system = make_system("parametric_pendulum");
    const Eigen::Index omega = system->parameter_index("omega");
    Errors worst;
    for (const ReferenceFlow& r : reference_flows(*system)) {
        CAPTURE(r.name);
        std::vector<double> times, phases;
        for (const double duration : r.durations) {
            times.push_back(duration / r.theta[omega]);
            phases.push_back(r.phase + duration);
        }
        const Eigen::MatrixXd f = system->rhs(r.states, phases, r.theta);
        Eigen::MatrixXd sensitivities = r.sensitivities;
        for (Eigen::Index k = 0; k < f.cols(); ++k)
            sensitivities.col(11 * k + 2 + omega) += f.col(k) * times[static_cast<std::size_t>(k)] / r.theta[omega];
        worst.take(
            errors_of(system->flow_with_sensitivities(r.start, r.phase, times, r.theta, all_parameters, Clock::time,
                                                      {.relative_tolerance = 1e-15, .absolute_tolerance = 1e-15}),
                      r, sensitivities));
    }
    // Measured 1.2e-13, times ten; derivatives as above.
    CHECK(worst.values < 1.2e-12);
    CHECK(worst.derivatives < rounding_of_derivatives);
}

TEST_CASE("second derivatives across crossings agree with 28 digits", "[models][reference]") {
    const auto system = make_system("parametric_pendulum");
    // Measured 3.1e-12 and 5.9e-15, times ten.
    constexpr std::array<std::array<double, 2>, 2> tolerance_and_bound{{{1e-12, 3.1e-11}, {1e-15, 5.9e-14}}};
    for (const auto& [tolerance, bound] : tolerance_and_bound) {
        double worst = 0.0;
        std::size_t compared = 0;
        for (const ReferenceFlow& r : reference_flows(*system)) {
            if (r.second_directions.empty()) continue;
            CAPTURE(r.name);
            ++compared;
            std::vector<Eigen::Index> free;
            for (const Eigen::Index direction : r.second_directions)
                if (direction >= 2) free.push_back(direction - 2);
            const auto d = static_cast<Eigen::Index>(r.second_directions.size());
            REQUIRE(d == static_cast<Eigen::Index>(free.size()) + 2);
            const auto flow = system->flow_with_second_derivatives(
                r.start, r.phase, std::array{r.durations.back()}, r.theta, free, Clock::phase,
                {.relative_tolerance = tolerance, .absolute_tolerance = tolerance});
            REQUIRE(flow.status == FlowStatus::ok);
            REQUIRE(flow.second_derivatives.allFinite());
            for (Eigen::Index i = 0; i < 2; ++i) {
                Eigen::MatrixXd second(d, d);
                for (Eigen::Index a = 0; a < d; ++a)
                    second.row(a) = flow.second_derivatives.row(i).segment(a * d, d);
                worst = std::max(worst, error_of_columns(second, r.second_derivatives[static_cast<std::size_t>(i)]));
            }
        }
        REQUIRE(compared == 2);
        CHECK(worst < bound);
    }
}

}  // namespace orbid::models::pendulum_friction_test

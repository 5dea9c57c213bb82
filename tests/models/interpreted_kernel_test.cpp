#include "models/interpreted_kernel.hpp"

#include <cmath>
#include <numbers>
#include <span>
#include <string>
#include <vector>

#include "models/kernel_system.hpp"
#include "models/registry.hpp"
#include "tests/catch.hpp"

using namespace orbid;
using models::EquationProblem;
using models::Equations;
using models::EquationText;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

std::shared_ptr<const models::System> interpreted(const EquationText& text) {
    std::vector<EquationProblem> problems;
    const auto equations = Equations::read(text, problems);
    for (const EquationProblem& problem : problems)
        UNSCOPED_INFO(problem.rule);
    REQUIRE(equations);
    std::string why;
    const auto kernel = models::interpreted_kernel(equations, why);
    INFO(why);
    REQUIRE(kernel);
    return std::make_shared<models::KernelSystem>(kernel);
}

/// Parameters of a model of the registry, with its own names and values.
std::vector<EquationText::Parameter> parameters_of(const models::System& system) {
    std::vector<EquationText::Parameter> list;
    for (const models::Parameter& p : system.parameters())
        list.push_back({std::string(p.name), std::string(p.unit), p.domain, p.default_value, p.typical_size});
    return list;
}

EquationText::Quantity quantity(const std::string& name, const std::string& text, bool angle = false) {
    return {name, text, "1", angle};
}

EquationText duffing() {
    EquationText text;
    text.coordinates = {quantity("x", "x_dot"),
                        quantity("x_dot", "gamma * cos(tau) - delta * x_dot - x * (alpha + beta * x * x)")};
    text.parameters = parameters_of(*models::make_system("duffing"));
    text.forcing = {"tau", "omega"};
    return text;
}

EquationText lorenz() {
    EquationText text;
    text.coordinates = {quantity("x", "sigma * (y - x)"), quantity("y", "x * (rho - z) - y"),
                        quantity("z", "x * y - beta * z")};
    text.parameters = parameters_of(*models::make_system("lorenz"));
    return text;
}

EquationText henon() {
    EquationText text;
    text.map = true;
    text.coordinates = {quantity("x", "1 - a * x * x + y"), quantity("y", "b * x")};
    text.parameters = parameters_of(*models::make_system("henon"));
    return text;
}

/// (M1) and (M2), with dry friction.
EquationText pendulum() {
    EquationText text;
    text.coordinates = {
        quantity("phi", "phi_dot", true),
        quantity("phi_dot",
                 "-(k1 * sign(phi_dot) + k2 * phi_dot + k3 * phi_dot * abs(phi_dot)) / (m * l * l) - P * sin(phi)")};
    text.definitions = {
        quantity("s", "sin(tau)"), quantity("root", "1 - epsilon^2 * s^2"),
        quantity("P", "g / l - A * omega^2 / l * (cos(tau) + epsilon * (cos(2 * tau) + epsilon^2 * s^4) / root^1.5)")};
    text.parameters = parameters_of(*models::make_system("parametric_pendulum"));
    text.parameters[2].value = 1e-3;  // k1: friction is on
    text.forcing = {"tau", "omega"};
    return text;
}

struct Case {
    std::string name;
    EquationText text;
    std::shared_ptr<const models::System> system;
    Eigen::VectorXd x0;
    double duration;
};

std::vector<Case> cases() {
    return {
        {"duffing", duffing(), models::make_system("duffing"), Eigen::Vector2d(0.3, -0.2), 20.0},
        {"lorenz", lorenz(), models::make_system("lorenz"), Eigen::Vector3d(1.0, 2.0, 20.0), 3.0},
        {"parametric_pendulum", pendulum(), models::make_system("parametric_pendulum"), Eigen::Vector2d(1.0, 2.0), 3.0},
        {"henon", henon(), models::make_system("henon"), Eigen::Vector2d(0.1, 0.2), 12.0}};
}

Eigen::VectorXd values_of(const Case& each) {
    Eigen::VectorXd theta(static_cast<Eigen::Index>(each.text.parameters.size()));
    for (Eigen::Index i = 0; i < theta.size(); ++i)
        theta[i] = each.text.parameters[static_cast<std::size_t>(i)].value;
    return theta;
}

/// Largest difference over the largest entry.
double difference(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
    REQUIRE(a.rows() == b.rows());
    REQUIRE(a.cols() == b.cols());
    return (a - b).cwiseAbs().maxCoeff() / b.cwiseAbs().maxCoeff();
}

}  // namespace

TEST_CASE("equations as text give the flows of the model they are", "[models][equations]") {
    for (const Case& each : cases()) {
        CAPTURE(each.name);
        const auto system = interpreted(each.text);
        const Eigen::VectorXd theta = values_of(each);
        const std::vector<double> durations{0.5 * each.duration, each.duration};
        const std::vector<Eigen::Index> free{0, 1};
        const auto clock = models::Clock::time;
        const auto mine = system->flow_with_sensitivities(each.x0, 0.3, durations, theta, free, clock);
        const auto theirs = each.system->flow_with_sensitivities(each.x0, 0.3, durations, theta, free, clock);
        REQUIRE(mine.status == models::FlowStatus::ok);
        // Same steps; what is left are roundings of formulas that are written differently, times the growth of errors
        // on the way. Measured: at most 3e-12 (lorenz).
        CHECK(mine.crossings == theirs.crossings);
        CHECK(difference(mine.states, theirs.states) < 3e-11);
        CHECK(difference(mine.sensitivities, theirs.sensitivities) < 3e-11);
        const auto second = system->flow_with_second_derivatives(each.x0, 0.3, durations, theta, free, clock);
        const auto their_second =
            each.system->flow_with_second_derivatives(each.x0, 0.3, durations, theta, free, clock);
        CHECK(difference(second.second_derivatives, their_second.second_derivatives) < 3e-10);
    }
}

TEST_CASE("equations as text give the ensembles of the model they are", "[models][equations]") {
    for (const Case& each : cases()) {
        CAPTURE(each.name);
        if (each.system->kind() == models::Kind::autonomous) continue;
        const auto system = interpreted(each.text);
        const Eigen::VectorXd theta = values_of(each);
        Eigen::MatrixXd starts(2, 40);
        for (Eigen::Index i = 0; i < starts.cols(); ++i)
            starts.col(i) = (0.5 + 0.02 * static_cast<double>(i)) * each.x0;
        const auto mine = system->ensemble(starts, 0.0, 3, theta),
                   theirs = each.system->ensemble(starts, 0.0, 3, theta);
        REQUIRE(mine.sections.size() == theirs.sections.size());
        for (std::size_t i = 0; i < mine.sections.size(); ++i)
            CHECK(difference(mine.sections[i], theirs.sections[i]) < 1e-10);
    }
}

TEST_CASE("equations as text give many flows at once", "[models][equations]") {
    for (const Case& each : cases()) {
        CAPTURE(each.name);
        const auto system = interpreted(each.text);
        const Eigen::VectorXd theta = values_of(each);
        Eigen::MatrixXd starts(each.x0.size(), 30);
        for (Eigen::Index i = 0; i < starts.cols(); ++i)
            starts.col(i) = (0.7 + 0.02 * static_cast<double>(i)) * each.x0;
        const std::vector<double> phases(30, 0.2), durations{each.system->kind() == models::Kind::map ? 2.0 : 0.7};
        std::vector<Eigen::Index> free{0, 1};
        if (theta.size() > 2) free.push_back(static_cast<Eigen::Index>(theta.size()) - 1);
        const auto mine = system->flows(starts, phases, durations, theta, free, models::Clock::time);
        const auto theirs = each.system->flows(starts, phases, durations, theta, free, models::Clock::time);
        for (std::size_t i = 0; i < mine.size(); ++i) {
            CHECK(difference(mine[i].states, theirs[i].states) < 1e-10);
            CHECK(difference(mine[i].sensitivities, theirs[i].sensitivities) < 1e-9);
        }
    }
}

TEST_CASE("sections of equations as text", "[models][equations]") {
    const auto system = interpreted(lorenz());
    const auto lorenz = models::make_system("lorenz");
    const models::Section section{Eigen::Vector3d(0.0, 0.0, 1.0), 27.0, -1};
    const Eigen::Vector3d x0(1.0, 2.0, 20.0);
    const Eigen::VectorXd theta = lorenz->default_parameters();
    const std::vector<Eigen::Index> free{1};
    const auto mine = system->crossings(x0, section, 3, 10.0, theta, free);
    const auto theirs = lorenz->crossings(x0, section, 3, 10.0, theta, free);
    CHECK(difference(mine.states, theirs.states) < 1e-10);
    CHECK(difference(mine.sensitivities, theirs.sensitivities) < 1e-9);
}

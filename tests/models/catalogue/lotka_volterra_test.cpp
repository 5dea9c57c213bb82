#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace orbid::models::lotka_volterra_test {

using tests::WithinAbs;

TEST_CASE("prey and predators conserve their integral", "[models][fast]") {
    const auto system = make_system("lotka_volterra");
    const Eigen::VectorXd p = system->default_parameters();
    const auto conserved = [&](const Eigen::Vector2d& x) {
        return p[3] * x[0] - p[2] * std::log(x[0]) + p[1] * x[1] - p[0] * std::log(x[1]);
    };
    const Eigen::Vector2d x0(30.0, 4.0);
    std::vector<double> durations;
    for (int i = 1; i <= 20; ++i)
        durations.push_back(5.0 * i);
    const auto flow = system->flow(x0, 0.0, durations, p, Clock::time);
    for (Eigen::Index k = 0; k < flow.states.cols(); ++k)
        CHECK_THAT(conserved(flow.states.col(k)), WithinAbs(conserved(x0), 1e-10));
    CHECK((flow.states.rowwise().maxCoeff() - flow.states.rowwise().minCoeff()).minCoeff() > 10.0);
    CHECK(system->at_rest(Eigen::Vector2d(p[2] / p[3], p[0] / p[1]), p));
    CHECK_FALSE(system->at_rest(x0, p));
}

TEST_CASE("prey and predators return after their period", "[models][reference]") {
    // Extrapolation in 40 digits: tests/reference/model_motions.py.
    std::ifstream in(orbid::tests::source_folder() + "/tests/reference/model_motions.json");
    const auto reference = nlohmann::json::parse(in)["lotka_volterra"];
    const auto system = make_system("lotka_volterra");
    const Eigen::VectorXd p = system->default_parameters();
    for (const auto& [name, value] : reference["parameters"].items())
        CHECK(p[system->parameter_index(name)] == value.get<double>());
    const Eigen::Vector2d start(reference["start"][0], reference["start"][1]);
    const double period = std::stod(reference["period"].get<std::string>());
    const auto flow = system->flow(start, 0.0, std::array{period}, p, Clock::time);
    // Some fifty steps with a local error of 1e-12 of forty thousand hares.
    CHECK((flow.states.col(0) - start).norm() < 1e-9);
    // About the equilibrium: harmonic with omega^2 = alpha gamma, u' = -(beta gamma / delta) v.
    const Eigen::Vector2d rest(p[2] / p[3], p[0] / p[1]);
    const double omega = std::sqrt(p[0] * p[2]);
    const auto small = system->flow_with_sensitivities(
        rest, 0.0, std::array{0.5 * std::numbers::pi / omega, 2.0 * std::numbers::pi / omega}, p, {}, Clock::time);
    const double ratio = p[1] * p[2] / p[3] / omega;
    Eigen::Matrix2d quarter;
    quarter << 0.0, -ratio, 1.0 / ratio, 0.0;
    CHECK((small.sensitivity(0, 2) - quarter).norm() < 1e-10);
    CHECK((small.sensitivity(1, 2) - Eigen::Matrix2d::Identity()).norm() < 1e-10);
}

}  // namespace orbid::models::lotka_volterra_test

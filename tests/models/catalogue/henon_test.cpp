#include "models/catalogue/henon.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"
#include "tests/models/catalogue/lyapunov.hpp"
#include "tests/source_folder.hpp"

namespace orbid::models::henon_test {

static_assert(MapModel<Henon>);

using tests::WithinAbs;
using tests::WithinRel;

TEST_CASE("the Henon map has its fixed points", "[models][reference]") {
    // a x^2 + (1 - b) x - 1 = 0, y = b x; multipliers -a x +- sqrt(a^2 x^2 + b).
    const auto system = make_system("henon");
    CHECK(system->kind() == Kind::map);
    const Eigen::VectorXd theta = system->default_parameters();
    const double a = theta[0], b = theta[1];
    for (const double sign : {1.0, -1.0}) {
        const double x = (b - 1.0 + sign * std::sqrt((1.0 - b) * (1.0 - b) + 4.0 * a)) / (2.0 * a);
        const Eigen::Vector2d fixed(x, b * x);
        const auto flow = system->flow_with_sensitivities(fixed, 0.0, std::array{1.0}, theta,
                                                          std::vector<Eigen::Index>{0, 1}, Clock::time);
        // Roundings of numbers of size one.
        CHECK((flow.states.col(0) - fixed).norm() < 1e-15);
        Eigen::MatrixXd expected(2, 4);
        expected << -2.0 * a * x, 1.0, -x * x, 0.0, b, 0.0, 0.0, x;
        CHECK((flow.sensitivities - expected).norm() < 1e-15);
        const Eigen::Vector2cd multipliers = flow.sensitivities.leftCols(2).eval().eigenvalues();
        const double root = std::sqrt(a * a * x * x + b);
        CHECK_THAT(std::max(multipliers[0].real(), multipliers[1].real()), WithinAbs(-a * x + root, 1e-14));
        CHECK_THAT(std::min(multipliers[0].real(), multipliers[1].real()), WithinAbs(-a * x - root, 1e-14));
    }
}

TEST_CASE("the tabulated cycles of the Henon map close, with their multipliers", "[models][reference]") {
    std::ifstream in(orbid::tests::source_folder() + "/tests/reference/henon_cycles.json");
    const auto table = nlohmann::json::parse(in);
    const auto system = make_system("henon");
    const Eigen::VectorXd theta = system->default_parameters();
    const auto number = [](const nlohmann::json& cycle, const char* key) {
        return std::stod(cycle[key].get<std::string>());
    };
    double worst_gap = 0.0, worst_multiplier = 0.0;
    REQUIRE(table["cycles"].size() == 17);
    for (const auto& cycle : table["cycles"]) {
        const double period = cycle["period"];
        CAPTURE(period);
        const Eigen::Vector2d start(number(cycle, "x"), number(cycle, "y"));
        const auto flow = system->flow_with_sensitivities(start, 0.0, std::array{period}, theta, {}, Clock::time);
        const double unstable = number(cycle, "unstable_multiplier");
        worst_gap = std::max(worst_gap, (flow.states.col(0) - start).norm() / std::abs(unstable));
        const Eigen::Matrix2d A = flow.sensitivities;
        const double determinant = std::pow(-theta[1], period);
        // Roundings of products of entries of the size of the unstable multiplier.
        CHECK_THAT(A.determinant(), WithinAbs(determinant, 1e-15 * A.squaredNorm()));
        worst_multiplier = std::max(worst_multiplier, std::abs((A.trace() - determinant / unstable) / unstable - 1.0));
    }
    // Measured 2.6e-16 and 4.2e-13, times ten.
    CHECK(worst_gap < 2.6e-15);
    CHECK(worst_multiplier < 4.2e-12);
}

TEST_CASE("the Henon map has its Lyapunov exponent", "[models][reference]") {
    // 0.41922 (J. C. Sprott, Chaos and Time-Series Analysis, 2003).
    const auto system = make_system("henon");
    const auto exponent = tests::largest_exponent(*system, Eigen::Vector2d(0.1, 0.1), system->default_parameters(),
                                                  10.0, 200, 200, Clock::time);
    CHECK(exponent.standard_error < 0.001);
    CHECK_THAT(exponent.mean, WithinAbs(0.41922, 4.0 * exponent.standard_error));
}

}  // namespace orbid::models::henon_test

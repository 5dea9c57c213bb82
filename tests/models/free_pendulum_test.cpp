#include <cmath>
#include <numbers>

#include "models/registry.hpp"
#include "tests/catch.hpp"

namespace orbid::models {

using tests::WithinAbs;

namespace {
constexpr double pi = std::numbers::pi;
}

TEST_CASE("a free pendulum is back after its exact period", "[models][reference]") {
    // T w0 / (2 pi) = 1 / agm(1, cos(amplitude / 2)); 60 decimal digits, rounded to 17.
    struct Row {
        double amplitude_deg, period_ratio;
    };
    const std::vector<Row> rows{{10.0, 1.0019071881432167},
                                {45.0, 1.0399733431968038},
                                {90.0, 1.1803405990160962},
                                {135.0, 1.5279475882343913},
                                {170.0, 2.4393627196738841}};
    const auto system = make_system("free_pendulum");
    Eigen::VectorXd theta(5);
    theta << 19.62, 0.0, 0.0, 0.0, 0.0;
    double worst_angle = 0.0, worst_rate = 0.0;
    for (const Row& row : rows) {
        const double start = row.amplitude_deg * pi / 180.0;
        const std::vector<double> period{row.period_ratio * 2.0 * pi / std::sqrt(19.62)};
        const auto flow = system->flow(Eigen::Vector2d(start, 0.0), 0.0, period, theta, Clock::time);
        CHECK(flow.crossings >= 1);
        worst_angle = std::max(worst_angle, std::abs(flow.states(0, 0) - start));
        worst_rate = std::max(worst_rate, std::abs(flow.states(1, 0)));
    }
    // Measured 8.1e-12 rad and 7.2e-11 rad/s (170 deg), times ten.
    CHECK(worst_angle < 8.1e-11);
    CHECK(worst_rate < 7.2e-10);
}

TEST_CASE("a free pendulum with dry friction comes to rest and stays", "[models][fast]") {
    const auto system = make_system("free_pendulum");
    Eigen::VectorXd theta = system->default_parameters();
    theta[1] = 0.3;
    const auto flow = system->flow(Eigen::Vector2d(1.0, 0.0), 0.0, std::vector{1e4}, theta, Clock::time);
    CHECK(flow.status == FlowStatus::ok);
    CHECK(flow.stickings == 1);
    CHECK(flow.states(1, 0) == 0.0);
    CHECK(std::abs(std::sin(flow.states(0, 0))) < 0.3 / 30.0);
    CHECK(system->at_rest(flow.states.col(0), theta));
    CHECK_FALSE(system->smooth(theta));
    CHECK(system->smooth(system->default_parameters()));
}

}  // namespace orbid::models

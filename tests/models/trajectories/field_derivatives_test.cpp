#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <vector>

#include <Eigen/Core>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"

namespace orbid::models::field_derivatives_test {

namespace {

/// d f / d(x, theta) by central differences of the fourth order.
Eigen::VectorXd difference(const System& system, const Eigen::VectorXd& x, double phase, const Eigen::VectorXd& theta,
                           Eigen::Index direction, double step) {
    const auto moved = [&](double by) -> Eigen::VectorXd {
        Eigen::VectorXd state = x, values = theta;
        (direction < x.size() ? state(direction) : values(direction - x.size())) += by * step;
        return system.rhs(state, std::vector{phase}, values);
    };
    return (8.0 * (moved(1.0) - moved(-1.0)) - (moved(2.0) - moved(-2.0))) / (12.0 * step);
}

}  // namespace

TEST_CASE("derivatives of the equations of every model agree with differences", "[field]") {
    for (const auto& entry : registered_models()) {
        const auto system = make_system(entry.name);
        if (!system->inputs().empty()) continue;
        INFO(entry.name);
        Eigen::VectorXd theta = system->default_parameters();
        // Inside the domain, so that a difference can step to both sides.
        for (double& value : theta)
            if (value == 0.0) value = 0.01;
        const Eigen::Index n = system->dimension(), q = theta.size();
        std::vector<Eigen::Index> free(static_cast<std::size_t>(q));
        std::iota(free.rbegin(), free.rend(), Eigen::Index{0});
        Eigen::MatrixXd states(n, 2);
        for (Eigen::Index i = 0; i < n; ++i)
            states.row(i) << 0.3 + 0.07 * std::sin(1.0 + static_cast<double>(i)),
                -0.2 + 0.05 * std::cos(static_cast<double>(i));
        const std::array phases{0.4, 1.9};
        const Eigen::MatrixXd exact = system->rhs_derivatives(states, phases, theta, free);
        REQUIRE(exact.rows() == n);
        REQUIRE(exact.cols() == 2 * (n + q));
        for (Eigen::Index k = 0; k < 2; ++k) {
            for (Eigen::Index j = 0; j < n + q; ++j) {
                const Eigen::Index direction = j < n ? j : n + free[static_cast<std::size_t>(j - n)];
                const double size = j < n ? 1.0 : std::max(1e-3, std::abs(theta(direction - n)));
                const double step = 3e-4 * size;
                const Eigen::VectorXd expected =
                    difference(*system, states.col(k), phases[static_cast<std::size_t>(k)], theta, direction, step);
                const double scale = 1.0 / size * (1.0 + system->rhs(states, phases, theta).cwiseAbs().maxCoeff());
                // h^4 of the difference and the rounding of values over h are below 1e-12; the rest is for the models
                // fifth derivatives (the gas spring of the landing gear: 1e-11).
                CHECK((exact.col(k * (n + q) + j) - expected).cwiseAbs().maxCoeff() < 1e-10 * scale);
            }
        }
    }
}

TEST_CASE("derivatives of the equations: values known in closed form, any number of coordinates", "[field]") {
    const auto lorenz = make_system("lorenz");
    const Eigen::Vector3d x(1.5, -2.0, 20.0), theta(10.0, 28.0, 8.0 / 3.0);
    Eigen::MatrixXd expected(3, 4);
    expected << -10.0, 10.0, 0.0, 0.0, 28.0 - 20.0, -1.0, -1.5, 1.5, -2.0, 1.5, -8.0 / 3.0, 0.0;
    CHECK(lorenz->rhs_derivatives(x, std::array{0.0}, theta, std::array{Eigen::Index{1}}) == expected);

    const auto ring = make_system("lorenz96", "", 11);
    Eigen::VectorXd y(11);
    for (Eigen::Index i = 0; i < 11; ++i)
        y(i) = 1.0 + 0.25 * static_cast<double>(i * i % 7);
    const Eigen::VectorXd force = ring->default_parameters();
    const Eigen::MatrixXd slope = ring->rhs_derivatives(y, std::array{0.0}, force, std::array{Eigen::Index{0}});
    for (Eigen::Index i = 0; i < 11; ++i) {
        const Eigen::Index up = (i + 1) % 11, down = (i + 10) % 11, two = (i + 9) % 11;
        Eigen::RowVectorXd row = Eigen::RowVectorXd::Zero(12);
        row(up) = y(down);
        row(down) = y(up) - y(two);
        row(two) = -y(down);
        row(i) = -1.0;
        row(11) = 1.0;
        CHECK(slope.row(i) == row);
    }
}

TEST_CASE("derivatives of the equations: the side of a switching surface, and wrong calls", "[field]") {
    const auto pendulum = make_system("parametric_pendulum");
    const Eigen::VectorXd theta = pendulum->default_parameters();
    Eigen::VectorXd with_friction = theta;
    with_friction(pendulum->parameter_index("k1")) = 1e-3;
    const std::array k1{pendulum->parameter_index("k1")};
    const double inertia = theta(pendulum->parameter_index("m")) * std::pow(theta(pendulum->parameter_index("l")), 2);
    for (const double v : {2.0, -2.0}) {
        const Eigen::MatrixXd slope =
            pendulum->rhs_derivatives(Eigen::Vector2d(0.3, v), std::array{0.0}, with_friction, k1);
        CHECK_THAT(slope(1, 2), tests::WithinRel(-std::copysign(1.0, v) / inertia, 1e-14));
    }
    CHECK_THROWS_AS(pendulum->rhs_derivatives(Eigen::Vector2d(0.3, 1.0), std::array{0.0, 1.0}, theta, k1),
                    std::invalid_argument);
    CHECK_THROWS_AS(
        pendulum->rhs_derivatives(Eigen::Vector2d(0.3, 1.0), std::array{0.0}, theta, std::array{theta.size()}),
        std::invalid_argument);
    CHECK(pendulum->forcing_frequency() == pendulum->parameter_index("omega"));
    CHECK_FALSE(make_system("lorenz")->forcing_frequency());
}

}  // namespace orbid::models::field_derivatives_test

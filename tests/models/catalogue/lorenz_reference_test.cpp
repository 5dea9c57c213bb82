#include <array>
#include <cmath>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"

namespace orbid::models::lorenz_reference_test {

namespace {

// The orbit AB from z = 27 at sigma = 10, rho = 28, beta = 8/3, to 50 digits, and derivatives of the state after one
// period from that start: R. Barrio, A. Dena, W. Tucker, computed with TIDES; d/drho is printed to nine digits.
constexpr double period = 1.5586522107161747275678702092126960705284805489972;
const Eigen::Vector3d start(-13.763610682134200525014401054361653864100864854092,
                            -19.578751942451795538838041446009558866114240053428, 27.0);
const Eigen::Vector3d by_sigma(-0.912802195703595109, -0.130905810340089968, 1.67609907947194769);
const Eigen::Vector3d by_beta(-28.2268059307864192, 18.1841834628623644, 116.876988007583165);
const Eigen::Vector3d by_rho(-3.67561474, 1.58865477, 15.11224225);
const Eigen::Vector3d by_sigma_twice(0.196143936526489815, 0.361143595741667101, -0.119613270510495917);

double relative_error(const Eigen::VectorXd& computed, const Eigen::VectorXd& expected) {
    return (computed - expected).cwiseQuotient(expected).cwiseAbs().maxCoeff();
}

}  // namespace

TEST_CASE("the orbit AB of Lorenz closes, with its derivatives to 12 digits", "[models][reference]") {
    const auto system = make_system("lorenz");
    const Eigen::VectorXd theta = system->default_parameters();
    const std::array<Eigen::Index, 3> free{system->parameter_index("sigma"), system->parameter_index("rho"),
                                           system->parameter_index("beta")};
    const std::array<double, 1> durations{period};
    for (const double tolerance : {1e-13, 1e-14}) {
        CAPTURE(tolerance);
        const FlowOptions options{.relative_tolerance = tolerance, .absolute_tolerance = tolerance};
        const auto flow =
            system->flow_with_second_derivatives(start, 0.0, durations, theta, free, Clock::time, options);
        REQUIRE(flow.status == FlowStatus::ok);
        // Measured at most 1.8e-15, 3.2e-13, 2.8e-14 and 2.6e-12, times ten. The start is rounded to 16 digits, which
        // the unstable multiplier 4.7 stretches: no program in doubles closes the orbit much better.
        CHECK(relative_error(flow.states.col(0), start) < 1.8e-14);
        CHECK(relative_error(flow.sensitivities.col(3), by_sigma) < 3.2e-12);
        CHECK(relative_error(flow.sensitivities.col(5), by_beta) < 2.8e-13);
        CHECK(relative_error(flow.second_derivatives.col(3 * 6 + 3), by_sigma_twice) < 2.6e-11);
        // Half a unit in the ninth decimal place.
        CHECK((flow.sensitivities.col(4) - by_rho).cwiseAbs().maxCoeff() <= 0.51e-8);
        // Without second derivatives the steps are the same.
        const auto first = system->flow_with_sensitivities(start, 0.0, durations, theta, free, Clock::time, options);
        CHECK(first.states == flow.states);
        CHECK(first.steps == flow.steps);
    }
}

}  // namespace orbid::models::lorenz_reference_test

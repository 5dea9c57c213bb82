// Closing errors at periods that a step of Newton's method in ln T may come to.
#include "periodic/discretisation/closing_error.hpp"

#include <limits>
#include <numbers>

#include "periodic/discretisation/shooting_steps.hpp"
#include "tests/catch.hpp"
#include "tests/periodic/orbit/closed_form_system.hpp"

namespace closing_error_test {

using namespace orbid;

TEST_CASE("an orbit of infinite or no period is no orbit", "[periodic]") {
    const tests::HopfNormalForm system;
    const Eigen::VectorXd theta = system.default_parameters();
    periodic::StartingSolution start;
    start.points = Eigen::Vector2d(1.0, 0.0);
    start.time = 2.0 * std::numbers::pi;
    const models::FlowOptions options;
    const periodic::ShootingMesh mesh = periodic::mesh_from_guess(system, theta, start, options);
    const periodic::FlowSteps steps(system, theta, mesh, options);
    const periodic::ClosingError closed = closing_error(steps, mesh.nodes, mesh.time);
    CHECK(closed.simulated);
    CHECK(closed.error.norm() < 1e-10);
    for (const double time : {0.0, std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN()})
        CHECK_FALSE(closing_error(steps, mesh.nodes, time).simulated);
}

}  // namespace closing_error_test

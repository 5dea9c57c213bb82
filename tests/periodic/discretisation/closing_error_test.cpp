// Closing errors at periods that a step of Newton's method in ln T may come to, and of steps that are split.
#include "periodic/discretisation/closing_error.hpp"

#include <limits>
#include <numbers>

#include "models/catalogue/registry.hpp"
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

TEST_CASE("steps in pieces end where whole ones do, with the same derivatives", "[periodic]") {
    models::FlowOptions options;
    options.relative_tolerance = options.absolute_tolerance = 1e-13;
    // Alone and, from six segments on, in a block; a clock of phase, and a period that is unknown.
    for (const char* name : {"driven_pendulum", "lorenz"})
        for (const int points : {2, 7}) {
            CAPTURE(name, points);
            const auto system = models::make_system(name);
            const Eigen::VectorXd theta = system->default_parameters();
            const Eigen::Index n = system->dimension();
            periodic::StartingSolution start;
            start.points = Eigen::MatrixXd::Constant(n, points, 1.0);
            for (Eigen::Index j = 0; j < points; ++j)
                start.points(n - 1, j) += 0.3 * static_cast<double>(j);
            if (system->kind() == models::Kind::autonomous) {
                start.points = start.points.col(0).eval();
                start.time = 1.5;
            }
            periodic::ShootingMesh mesh = periodic::mesh_from_guess(*system, theta, start, options);
            if (system->kind() == models::Kind::autonomous)
                mesh = periodic::split_uniformly(*system, theta, mesh, points, options);
            const periodic::FlowSteps steps(*system, theta, mesh, options);
            const std::vector<Eigen::Index> free{1, 0};
            std::vector<int> pieces(static_cast<std::size_t>(points), 1);
            pieces.back() = 3;
            const auto none = Eigen::MatrixXd::Zero(n, points);
            const periodic::ClosingError whole = closing_error(steps, mesh.nodes, mesh.time, none, free);
            const periodic::ClosingError split = closing_error(steps, mesh.nodes, mesh.time, none, free, pieces);
            REQUIRE(whole.simulated);
            REQUIRE(split.simulated);
            // Errors of the flow, grown tenfold.
            const auto near = [](const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
                return (a - b).cwiseAbs().maxCoeff() < 1e-11 * (1.0 + b.cwiseAbs().maxCoeff());
            };
            CHECK(near(split.error, whole.error));
            CHECK(near(split.parameters, whole.parameters));
            CHECK(split.by_ln_time.cols() == whole.by_ln_time.cols());
            if (whole.by_ln_time.size() > 0) CHECK(near(split.by_ln_time, whole.by_ln_time));
            CHECK(whole.factors == whole.jacobians);
            CHECK(near(split.jacobians.back(), whole.jacobians.back()));
            const auto& f = split.factors;
            CHECK(f.size() == static_cast<std::size_t>(points < 6 ? points + 2 : 3 * points));
            CHECK(near(f[f.size() - 1] * f[f.size() - 2] * f[f.size() - 3], split.jacobians.back()));
            // A step that cannot be followed is told, also in pieces.
            if (system->kind() != models::Kind::autonomous) continue;
            Eigen::MatrixXd lost = mesh.nodes;
            lost(0, points - 1) = 1e200;
            const auto images = steps.advance_all(lost, mesh.time, free, pieces);
            CHECK(images.front().simulated);
            CHECK_FALSE(images.back().simulated);
        }
}

}  // namespace closing_error_test

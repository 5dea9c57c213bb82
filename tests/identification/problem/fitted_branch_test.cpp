// The branch of an estimate: one piece where it is followed through its folds, several where these are out of reach.
#include "identification/problem/fitted_branch.hpp"

#include "tests/periodic/orbit/steady_state.hpp"

namespace fitted_branch_test {

using namespace orbid;
using namespace orbid::tests;
using identification::FittedPiece;

namespace {

/// Duffing's oscillator at omega = 1.4 between its folds at 1.267 and 1.580: a large orbit and a small one, both
/// stable.
std::vector<FittedPiece> pieces_over(double lower, double upper, std::vector<periodic::OrbitReading> readings = {}) {
    identification::IdentificationProblem problem;
    problem.system = models::make_system("duffing", "");
    const models::System& system = *problem.system;
    problem.values =
        with_values(system, {{"alpha", 1.0}, {"beta", 0.3}, {"gamma", 0.4}, {"delta", 0.1}, {"omega", 1.4}});
    problem.parameters = {identification::free_parameter(system, "delta", 0.1)};
    identification::BranchChoice& branch = problem.branch.emplace();
    branch.parameter = system.parameter_index("omega");
    branch.channels.resize(1);
    branch.at = Eigen::Vector2d(1.4, 1.4);
    branch.values = Eigen::RowVector2d(2.15, 0.44);
    branch.start.points = Eigen::Vector2d(1.4, 2.35);
    branch.range.emplace(lower, upper);
    branch.readings = std::move(readings);
    problem = identification::completed(problem);
    const identification::EstimateSetup setup = identification::estimate_setup(problem, {});

    std::vector<periodic::MeasuredOrbit> orbits(2);
    for (Eigen::Index i = 0; i < 2; ++i) {
        periodic::MeasuredOrbit& orbit = orbits[static_cast<std::size_t>(i)];
        orbit.label = i == 0 ? "large" : "small";
        orbit.binding = setup.model;
        orbit.values = branch.values.col(i);
        periodic::StartingSolution start;
        start.points = i == 0 ? Eigen::Vector2d(1.4, 2.35) : Eigen::Vector2d(-0.43, 0.0);
        orbit.starts = {start};
    }
    periodic::BranchOptions options;
    options.channels.resize(1);
    options.start = setup.start();
    const periodic::BranchResidual residual(problem.system, orbits, options);
    REQUIRE(residual.start_status(0) == periodic::OrbitStatus::converged);
    REQUIRE(residual.start_status(1) == periodic::OrbitStatus::converged);
    return fitted_branch(problem, setup, residual, residual.initial_set(), setup.start());
}

}  // namespace

TEST_CASE("a branch with its folds is one piece", "[identification][branch]") {
    const auto pieces = pieces_over(1.0, 1.8);
    REQUIRE(pieces.size() == 1);
    CHECK(pieces[0].from == "the start");
    CHECK(pieces[0].branch.points.front().parameter == 1.0);
    CHECK(pieces[0].branch.points.back().parameter == 1.8);
}

TEST_CASE("motions that a followed branch does not reach have pieces of their own", "[identification][branch]") {
    const auto system = models::make_system("duffing", "");
    const auto names = models::reading_names(system->coordinates(), system->parameters());
    const auto pieces = pieces_over(1.3, 1.5, {{"square", "m^2", models::Expression::parse("x^2", names)}});
    REQUIRE(pieces.size() == 2);
    CHECK(pieces[0].from == "the start");
    CHECK(pieces[1].from == "small");
    for (const FittedPiece& piece : pieces) {
        CHECK(piece.branch.points.front().parameter * piece.branch.points.back().parameter == 1.3 * 1.5);
        for (const periodic::BranchPoint& point : piece.branch.points) {
            CHECK(point.unstable == 0);
            REQUIRE(point.amplitude.mean.size() == 3);
            // The mean of the square is the square of the root mean square.
            CHECK_THAT(point.amplitude.mean(2), WithinRel(point.amplitude.rms(0) * point.amplitude.rms(0), 1e-9));
        }
    }
    CHECK(pieces[0].branch.points[1].amplitude.half_range(0) > 1.5);
    CHECK(pieces[1].branch.points[1].amplitude.half_range(0) < 0.7);
}

}  // namespace fitted_branch_test

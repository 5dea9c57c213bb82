#include "periodic/branches/continuation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include <tbb/global_control.h>

#include "models/catalogue/registry.hpp"
#include "models/system/stopped.hpp"
#include "tests/catch.hpp"
#include "tests/periodic/orbit/branch_maps.hpp"
#include "tests/periodic/orbit/closed_form_system.hpp"

namespace continuation_test {

using namespace orbid;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using periodic::Bifurcation;
using periodic::BifurcationDiagram;
using periodic::Branch;
using periodic::BranchEnd;
using periodic::BranchPoint;
using periodic::ContinuationOptions;
using periodic::follow_branches;
using periodic::OrbitStatus;
using periodic::StartingSolution;

namespace {

/// The first doubling on each branch that has one, in the order of the periods.
std::vector<BranchPoint> doublings(const BifurcationDiagram& diagram) {
    std::vector<BranchPoint> found;
    for (const Branch& branch : diagram.branches)
        for (const BranchPoint& point : branch.points)
            if (point.bifurcation == Bifurcation::period_doubling) {
                found.push_back(point);
                break;
            }
    return found;
}

}  // namespace

TEST_CASE("logistic map: the first five doublings of the cascade", "[periodic][reference]") {
    const auto system = models::make_system("logistic");
    VectorXd theta = system->default_parameters();
    theta(0) = 2.8;
    StartingSolution start;
    start.points = MatrixXd::Constant(1, 1, 0.6);
    ContinuationOptions options;
    options.lower = 2.5;
    options.upper = 3.9;
    options.maximum_period = 16;
    const BifurcationDiagram diagram = follow_branches(*system, theta, start, options);
    REQUIRE(diagram.start_status == OrbitStatus::converged);
    REQUIRE(diagram.branches.size() == 5);
    // 3 and 1 + sqrt(6) in closed form, the others from the OEIS, A086181, A091517, and K. Briggs' table.
    const std::array expected{3.0, 1.0 + std::sqrt(6.0), 3.544090359551922, 3.564407266095, 3.568759419544};
    const auto found = doublings(diagram);
    REQUIRE(found.size() == expected.size());
    for (std::size_t k = 0; k < expected.size(); ++k) {
        CAPTURE(k);
        CHECK(found[k].orbit.period == 1 << k);
        // Measured: 4e-14 where all digits are known; times ten, and the digits given.
        CHECK_THAT(found[k].parameter, tests::WithinAbs(expected[k], k < 3 ? 4e-13 : 1e-12));
        CHECK(found[k].parameter_error < 1e-12);
        CHECK_THAT(found[k].orbit.multipliers[0].real(), tests::WithinAbs(-1.0, 1e-10));
    }
    for (std::size_t k = 0; k < 5; ++k) {
        const Branch& branch = diagram.branches[k];
        CHECK(branch.origin.has_value() == (k > 0));
        CHECK(branch.last == BranchEnd::bound);
        CHECK(branch.points.back().parameter == 3.9);
        if (k > 0) CHECK(branch.points.front().parameter == found[k - 1].parameter);
    }
    CHECK(diagram.branches[0].first == BranchEnd::bound);
    CHECK(diagram.branches[0].points.front().parameter == 2.5);
}

TEST_CASE("folds, and the whole of a branch that closes: fixed points on a circle", "[periodic]") {
    const tests::CircleMap system;
    StartingSolution start;
    start.points = MatrixXd::Constant(1, 1, 0.8);
    ContinuationOptions options;
    options.lower = -2.0;
    options.upper = 2.0;
    options.direction = 1;
    const BifurcationDiagram diagram = follow_branches(system, VectorXd::Constant(1, 0.6), start, options);
    REQUIRE(diagram.branches.size() == 1);
    const Branch& branch = diagram.branches[0];
    CHECK(branch.first == BranchEnd::start);
    CHECK(branch.last == BranchEnd::closed);
    std::vector<double> folds;
    for (const BranchPoint& point : branch.points) {
        // Every point lies on the circle, and is stable where it is right of the middle. Measured 2e-16.
        CHECK_THAT(std::hypot(point.parameter, point.orbit.points(0, 0)), tests::WithinAbs(1.0, 1e-14));
        if (point.bifurcation == Bifurcation::fold)
            folds.push_back(point.parameter);
        else
            CHECK(point.unstable == (point.orbit.points(0, 0) > 0.0 ? 0 : 1));
        CHECK(point.bifurcation != Bifurcation::branch_point);
    }
    REQUIRE(folds.size() == 2);
    CHECK_THAT(folds[0], tests::WithinAbs(1.0, 1e-14));
    CHECK_THAT(folds[1], tests::WithinAbs(-1.0, 1e-14));
    CHECK_THAT(branch.points.back().orbit.points(0, 0), tests::WithinAbs(0.8, 1e-12));
    CHECK_THAT(branch.points.back().parameter, tests::WithinAbs(0.6, 1e-12));
}

TEST_CASE("branches that cross, with and without a symmetry", "[periodic]") {
    for (const double skew : {0.0, 1.0}) {
        CAPTURE(skew);
        const tests::CrossingMap system(skew);
        StartingSolution start;
        start.points = MatrixXd::Zero(1, 1);
        ContinuationOptions options;
        options.lower = -0.7;
        options.upper = 0.3;
        options.solver.scale = VectorXd::Ones(1);
        const BifurcationDiagram diagram = follow_branches(system, VectorXd::Constant(1, -0.3), start, options);
        // With the skew term another branch, x = (1 - sqrt(1 + 4 lambda)) / 2 and its other half, crosses at 0. Without
        // it x = +-sqrt(lambda) begins there, and the symmetry makes one of the two halves enough.
        REQUIRE(diagram.branches.size() == (skew == 0.0 ? 2 : 3));
        const auto& trunk = diagram.branches[0].points;
        const auto crossing = std::find_if(trunk.begin(), trunk.end(), [](const BranchPoint& point) {
            return point.bifurcation == Bifurcation::branch_point;
        });
        REQUIRE(crossing != trunk.end());
        // Measured 2e-18.
        CHECK_THAT(crossing->parameter, tests::WithinAbs(0.0, 1e-15));
        for (std::size_t b = 1; b < diagram.branches.size(); ++b) {
            CHECK(diagram.branches[b].origin->branch == 0);
            for (const BranchPoint& point : diagram.branches[b].points) {
                const double x = point.orbit.points(0, 0);
                CHECK_THAT(point.parameter, tests::WithinAbs(x * x - skew * x, 5e-15));
            }
        }
    }
}

TEST_CASE("Neimark-Sacker of the delayed logistic map at a = 2", "[periodic]") {
    const tests::DelayedLogisticMap system;
    StartingSolution start;
    start.points = Eigen::Vector2d(1.0 / 3.0, 1.0 / 3.0);
    ContinuationOptions options;
    options.lower = 1.2;
    options.upper = 2.4;
    const BifurcationDiagram diagram = follow_branches(system, VectorXd::Constant(1, 1.5), start, options);
    REQUIRE(diagram.branches.size() == 1);
    std::vector<BranchPoint> found;
    for (const BranchPoint& point : diagram.branches[0].points)
        if (point.bifurcation != Bifurcation::none) found.push_back(point);
    REQUIRE(found.size() == 1);
    CHECK(found[0].bifurcation == Bifurcation::neimark_sacker);
    // Fixed point 1 - 1 / a with multipliers exp(+-i pi / 3). Measured 0 and 3e-16; the search
    // stops at 1e-13.
    CHECK_THAT(found[0].parameter, tests::WithinAbs(2.0, 1e-12));
    CHECK(std::abs(found[0].orbit.multipliers[0] - std::polar(1.0, std::numbers::pi / 3.0)) < 1e-12);
    CHECK(diagram.branches[0].points.back().unstable == 2);
}

TEST_CASE("a branch between two doublings is followed once", "[periodic]") {
    const tests::BubbleMap system;
    StartingSolution start;
    start.points = MatrixXd::Constant(1, 1, 0.6);
    ContinuationOptions options;
    options.lower = -0.9;
    options.upper = 0.9;
    const BifurcationDiagram diagram = follow_branches(system, VectorXd::Constant(1, 0.8), start, options);
    REQUIRE(diagram.branches.size() == 2);
    std::vector<double> places;
    for (const BranchPoint& point : diagram.branches[0].points)
        if (point.bifurcation == Bifurcation::period_doubling) places.push_back(point.parameter);
    REQUIRE(places.size() == 2);
    // Measured 2e-15, times ten and the accuracy of the search.
    CHECK_THAT(places[0], tests::WithinAbs(-std::sqrt(0.2), 1e-13));
    CHECK_THAT(places[1], tests::WithinAbs(std::sqrt(0.2), 1e-13));
    const Branch& bubble = diagram.branches[1];
    CHECK(bubble.first == BranchEnd::other_branch);
    CHECK(bubble.last == BranchEnd::other_branch);
    CHECK(bubble.points.front().parameter == places[0]);
    // Located from the branch that ends, to the root of rounding in its points: measured 2e-11 in the parameter.
    CHECK_THAT(bubble.points.back().parameter, tests::WithinAbs(places[1], 2e-10));
    for (const BranchPoint& point : bubble.points) {
        // The two points of the orbit: x1 + x2 = (r + 1) / r.
        const double r = 3.2 - point.parameter * point.parameter;
        CHECK_THAT(point.orbit.points.sum(), tests::WithinAbs((r + 1.0) / r, 1e-9));
        CHECK(point.orbit.period == 2);
    }
}

TEST_CASE("a multiplier that changes its sign through infinity doubles no period", "[periodic][analytic]") {
    const tests::PoleMap system;
    StartingSolution start;
    start.points = MatrixXd::Zero(1, 1);
    ContinuationOptions options;
    options.lower = -0.5;
    options.upper = 0.9;
    const BifurcationDiagram diagram = follow_branches(system, VectorXd::Constant(1, 0.5), start, options);
    REQUIRE(diagram.branches.size() == 1);
    const Branch& branch = diagram.branches[0];
    // The multiplier goes from 1 / 0.9 to -2 over +-1e7; -1 and 1 lie outside the range.
    CHECK(branch.points.front().parameter * branch.points.back().parameter < 0.0);
    for (const BranchPoint& point : branch.points)
        CHECK(point.bifurcation == Bifurcation::none);
}

TEST_CASE("an asymmetric branch between two losses of symmetry is followed once", "[periodic]") {
    const tests::ArchMap system;
    StartingSolution start;
    start.points = MatrixXd::Zero(1, 1);
    ContinuationOptions options;
    options.lower = -0.9;
    options.upper = 0.9;
    options.solver.scale = VectorXd::Ones(1);
    const BifurcationDiagram diagram = follow_branches(system, VectorXd::Constant(1, 0.8), start, options);
    REQUIRE(diagram.branches.size() == 2);
    const Branch& arch = diagram.branches[1];
    CHECK(arch.last == BranchEnd::other_branch);
    // Measured 2e-16 at both ends, 4e-16 for all points.
    CHECK_THAT(arch.points.front().parameter, tests::WithinAbs(-std::sqrt(0.2), 3e-15));
    CHECK_THAT(arch.points.back().parameter, tests::WithinAbs(std::sqrt(0.2), 3e-15));
    CHECK(arch.points.size() > 10);
    for (const BranchPoint& point : arch.points)
        CHECK_THAT(std::hypot(point.parameter, point.orbit.points(0, 0)), tests::WithinRel(std::sqrt(0.2), 4e-15));
}

TEST_CASE("a diagram is the same with any number of threads", "[periodic][threads]") {
    const auto system = models::make_system("duffing");
    VectorXd theta(5);
    theta << 0.1, 1.0, 0.25, 0.5, 0.5;
    StartingSolution start;
    start.points = Eigen::Vector2d(0.65, 0.05);
    ContinuationOptions options;
    options.parameter = 4;
    options.lower = 0.4;
    options.upper = 1.2;
    options.solver.maximum_distance = 1.0;
    options.solver.segment_growth = 3.0;  // several nodes, solved in parallel
    const auto run = [&](std::size_t threads) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        return follow_branches(*system, theta, start, options);
    };
    const BifurcationDiagram one = run(1);
    const BifurcationDiagram four = run(4);
    REQUIRE(one.branches.size() == 1);
    REQUIRE(four.branches.size() == 1);
    REQUIRE(one.branches[0].points.size() == four.branches[0].points.size());
    CHECK(one.branches[0].points.size() > 10);
    for (std::size_t k = 0; k < one.branches[0].points.size(); ++k) {
        const BranchPoint& a = one.branches[0].points[k];
        const BranchPoint& b = four.branches[0].points[k];
        CHECK(a.parameter == b.parameter);
        CHECK(a.orbit.points == b.orbit.points);
        CHECK(a.orbit.multipliers == b.orbit.multipliers);
    }
}

TEST_CASE("a branch follows the forcing frequency in the phase, and ends at the edge of the domain", "[periodic]") {
    const tests::ForcedOscillator system;
    VectorXd theta = system.default_parameters();
    StartingSolution start;
    start.phase = 0.7;
    start.points = tests::ForcedOscillator::steady(0.7, theta.cast<tests::Complex>()).real();
    ContinuationOptions options;
    options.parameter = 3;
    options.lower = 1.0;
    options.upper = 3.0;
    BifurcationDiagram diagram = follow_branches(system, theta, start, options);
    REQUIRE(diagram.branches.size() == 1);
    CHECK(diagram.branches[0].points.front().parameter == 1.0);
    CHECK(diagram.branches[0].points.back().parameter == 3.0);
    for (const BranchPoint& point : diagram.branches[0].points) {
        theta(3) = point.parameter;
        const Eigen::Vector2d exact = tests::ForcedOscillator::steady(0.7, theta.cast<tests::Complex>()).real();
        CHECK((point.orbit.points.col(0) - exact).norm() < 4e-14);  // measured 4e-15, times ten
        CHECK_THAT(point.amplitude.half_range(0),
                   tests::WithinRel(theta(2) / std::hypot(theta(0) - theta(3) * theta(3), theta(1) * theta(3)), 1e-10));
    }
    // Damping, >= 0, asked for down to -1.
    theta(3) = 2.3;
    options.parameter = 1;
    options.lower = -1.0;
    options.upper = 1.0;
    diagram = follow_branches(system, theta, start, options);
    REQUIRE(diagram.branches.size() == 1);
    CHECK(diagram.branches[0].first == BranchEnd::domain);
    CHECK(diagram.branches[0].points.front().parameter == 0.0);
    CHECK(diagram.branches[0].last == BranchEnd::bound);
}

TEST_CASE("continuation refuses a wrong call", "[periodic]") {
    const auto system = models::make_system("logistic");
    const VectorXd theta = VectorXd::Constant(1, 2.8);
    StartingSolution start;
    start.points = MatrixXd::Constant(1, 1, 0.6);
    ContinuationOptions options;
    options.lower = 2.5;
    options.upper = 3.9;
    const auto refused = [&](auto change) {
        ContinuationOptions wrong = options;
        change(wrong);
        CHECK_THROWS_AS(follow_branches(*system, theta, start, wrong), std::invalid_argument);
    };
    refused([](auto& o) { o.parameter = 1; });
    refused([](auto& o) { o.lower = 3.0; });
    refused([](auto& o) { o.upper = 2.0; });
    refused([](auto& o) { o.lower = std::nan(""); });
    refused([](auto& o) { o.direction = 2; });
    refused([](auto& o) { o.smallest_step = 0.0; });
    refused([](auto& o) { o.first_step = 1e-9; });
    refused([](auto& o) { o.largest_step = 1e-3; });
    refused([](auto& o) { o.maximum_points = 1; });
    refused([](auto& o) { o.maximum_period = 0; });
    refused([](auto& o) { o.maximum_branches = 0; });
    refused([](auto& o) { o.longest = 0.0; });
}

TEST_CASE("continuation says why there is no branch", "[periodic]") {
    const auto system = models::make_system("henon");
    StartingSolution start;
    start.points = Eigen::Vector2d(0.0, 0.0);
    VectorXd theta = system->default_parameters();
    theta(0) = -2.0;  // no fixed points below a = -(1 - b)^2 / 4
    ContinuationOptions options;
    options.lower = -3.0;
    options.upper = 1.0;
    const BifurcationDiagram diagram = follow_branches(*system, theta, start, options);
    CHECK(diagram.start_status != OrbitStatus::converged);
    CHECK(diagram.branches.empty());
}

TEST_CASE("a diagram that is asked to stop has the branches until then", "[periodic]") {
    const auto map = models::make_system("logistic");
    VectorXd theta = map->default_parameters();
    theta(0) = 2.8;
    ContinuationOptions options;
    options.lower = 2.8;
    options.upper = 3.56;
    StartingSolution start;
    start.points = MatrixXd::Constant(1, 1, 1.0 - 1.0 / 2.8);
    const BifurcationDiagram whole = follow_branches(*map, theta, start, options);
    REQUIRE(whole.branches.size() > 2);
    int asked = 0;
    options.interrupted = [&] { return ++asked > 3; };
    const BifurcationDiagram part = follow_branches(*map, theta, start, options);
    REQUIRE(part.branches.size() == 1);
    CHECK(part.branches[0].last == BranchEnd::interrupted);
    CHECK(part.branches[0].points.size() >= 2);
    CHECK(part.branches[0].points.size() < whole.branches[0].points.size());
}

TEST_CASE("a stop in the first step backwards keeps the half of the branch before", "[periodic]") {
    int asked = 0, limit = 0;
    const auto plain = models::make_system("duffing");
    const auto system = plain->with_stop([&] { return ++asked > limit; });
    VectorXd theta = plain->default_parameters();
    ContinuationOptions options;
    options.parameter = plain->parameter_index("gamma");
    theta(options.parameter) = 0.02;
    options.lower = 0.01;
    options.upper = 0.03;
    StartingSolution start;
    start.points = Eigen::Vector2d(1.0, 0.0);
    options.direction = 1;
    limit = 1 << 30;
    const BifurcationDiagram ahead = follow_branches(*system, theta, start, options);
    REQUIRE(ahead.branches.size() == 1);
    // As many questions are answered as the half ahead needs.
    options.direction = 0;
    limit = std::exchange(asked, 0);
    const BifurcationDiagram part = follow_branches(*system, theta, start, options);
    REQUIRE(part.branches.size() == 1);
    CHECK(part.branches[0].first == BranchEnd::interrupted);
    CHECK(part.branches[0].points.size() == ahead.branches[0].points.size());
    CHECK(part.branches[0].points.back().orbit.points == ahead.branches[0].points.back().orbit.points);
    // A few more, and the half backwards has points of its own, each described.
    limit += limit / 2;
    asked = 0;
    const BifurcationDiagram more = follow_branches(*system, theta, start, options);
    REQUIRE(more.branches.size() == 1);
    CHECK(more.branches[0].first == BranchEnd::interrupted);
    CHECK(more.branches[0].points.size() > part.branches[0].points.size());
    for (const BranchPoint& point : more.branches[0].points)
        CHECK(point.amplitude.half_range.size() == 2);
}

}  // namespace continuation_test

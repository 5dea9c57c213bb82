#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numbers>
#include <vector>

#include <Eigen/LU>

#include "models/catalogue/registry.hpp"
#include "periodic/branches/continuation.hpp"
#include "tests/catch.hpp"
#include "tests/periodic/orbit/closed_form_system.hpp"

namespace bifurcations_test {

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

/// The bifurcations of one kind on a branch, in their order.
std::vector<BranchPoint> found(const Branch& branch, Bifurcation kind) {
    std::vector<BranchPoint> points;
    std::copy_if(branch.points.begin(), branch.points.end(), std::back_inserter(points),
                 [&](const BranchPoint& point) { return point.bifurcation == kind; });
    return points;
}

/// The stable orbit of period one that a forced model runs into.
StartingSolution settled(const models::System& system, const VectorXd& theta, VectorXd x) {
    const double durations[] = {2.0 * std::numbers::pi};
    for (int k = 0; k < 400; ++k) {
        x = system.flow(x, 0.0, durations, theta, models::Clock::phase).states.col(0);
        if (system.coordinates()[0].angle) x(0) = models::wrapped(x(0));
    }
    StartingSolution start;
    start.points = x;
    return start;
}

}  // namespace

TEST_CASE("the cascade of the pendulum from the locked rotation at 13 rad/s", "[periodic][reference]") {
    const auto system = models::make_system("parametric_pendulum");
    VectorXd theta = system->default_parameters();
    ContinuationOptions options;
    options.parameter = system->parameter_index("omega");
    options.lower = 9.0;
    options.upper = 13.0;
    options.maximum_period = 16;
    theta(options.parameter) = 13.0;
    const StartingSolution start = settled(*system, theta, Eigen::Vector2d(0.0, 13.0));
    const BifurcationDiagram diagram = follow_branches(*system, theta, start, options);
    REQUIRE(diagram.start_status == OrbitStatus::converged);
    REQUIRE(diagram.branches.size() == 5);
    // AUTO-07p 0.9.2, bench/auto/cascade.sh: the digits it prints. Its 50 collocation intervals leave 2e-9 on the first
    // one (200 intervals: 12.107821884), 1e-10 or so on the others, which get more of them.
    const std::array expected{12.107821882, 9.4647067819, 9.3204145005, 9.2998306142, 9.2959532790};
    std::vector<double> doublings;
    for (std::size_t b = 0; b < 5; ++b) {
        CAPTURE(b);
        const Branch& branch = diagram.branches[b];
        const int period = 1 << b;
        CHECK(branch.points[0].orbit.period == period);
        CHECK(branch.points[0].orbit.rotation == std::vector<int>{-period});
        CHECK(branch.points.back().parameter == (b == 0 ? 13.0 : 9.0));
        const auto here = found(branch, Bifurcation::period_doubling);
        REQUIRE(here.size() == 1);
        CHECK_THAT(here[0].parameter, tests::WithinAbs(expected[b], 5e-9));
        CHECK(here[0].parameter_error < 1e-10);
        CHECK_THAT(here[0].orbit.multipliers[0].real(), tests::WithinAbs(-1.0, 1e-9));
        doublings.push_back(here[0].parameter);
        for (const BranchPoint& point : branch.points)
            CHECK(point.orbit.residual < 1e-10);  // measured 7.7e-12 at most
    }
    const auto ratios = periodic::doubling_ratios(doublings);
    REQUIRE(ratios.size() == 3);
    CHECK_THAT(ratios[2], tests::WithinAbs(5.30877, 1e-5));  // from AUTO's doublings; 4.669 in the limit
}

TEST_CASE("a doubling is where the branch of twice the period begins", "[periodic]") {
    // Along that branch the parameter is even in the amplitude: lambda(a) = lambda_0 + c a^2 + d a^4. Three orbits near
    // its beginning give lambda_0 without any multiplier.
    const auto system = models::make_system("parametric_pendulum");
    VectorXd theta = system->default_parameters();
    ContinuationOptions options;
    options.parameter = system->parameter_index("omega");
    options.lower = 12.0;
    options.upper = 13.0;
    options.maximum_period = 2;
    options.maximum_points = 40;
    theta(options.parameter) = 12.5;
    const StartingSolution start = settled(*system, theta, Eigen::Vector2d(0.0, 13.0));
    const BifurcationDiagram diagram = follow_branches(*system, theta, start, options);
    REQUIRE(diagram.branches.size() == 2);
    const auto doublings = found(diagram.branches[0], Bifurcation::period_doubling);
    REQUIRE(doublings.size() == 1);
    const auto& points = diagram.branches[1].points;
    REQUIRE(points.size() > 4);
    Eigen::Matrix3d powers;
    Eigen::Vector3d values;
    for (int k = 0; k < 3; ++k) {
        const MatrixXd& x = points[static_cast<std::size_t>(k + 1)].orbit.points;
        const double square = (x.col(0) - x.col(1)).squaredNorm();
        powers.row(k) << 1.0, square, square * square;
        values(k) = points[static_cast<std::size_t>(k + 1)].parameter;
    }
    const double begin = powers.fullPivLu().solve(values)(0);
    // The term a^6 that is left out: measured 1.9e-8 where the parameter changes by 1.6e-2 over the three orbits; times
    // ten.
    CHECK_THAT(begin, tests::WithinAbs(doublings[0].parameter, 2e-7));
}

TEST_CASE("Duffing's resonance: folds, and both sides of them", "[periodic]") {
    const auto system = models::make_system("duffing");
    VectorXd theta(5);
    theta << 0.1, 1.0, 0.25, 0.5, 0.5;
    ContinuationOptions options;
    options.parameter = 4;
    options.lower = 0.4;
    options.upper = 3.0;
    const BifurcationDiagram diagram =
        follow_branches(*system, theta, settled(*system, theta, Eigen::Vector2d(0.5, 0.0)), options);
    REQUIRE(diagram.branches.size() == 1);
    const Branch& branch = diagram.branches[0];
    CHECK(branch.points.front().parameter == 0.4);
    CHECK(branch.points.back().parameter == 3.0);
    const auto folds = found(branch, Bifurcation::fold);
    REQUIRE(folds.size() == 2);
    CHECK(folds[0].parameter > folds[1].parameter);
    for (const BranchPoint& fold : folds) {
        CHECK(fold.parameter_error < 1e-12);
        // Measured 5e-15. (Its slope is infinite in the parameter, not along the branch.)
        CHECK_THAT(fold.orbit.multipliers[0].real(), tests::WithinAbs(1.0, 1e-13));
        // On either side of the parameter there are two orbits, or none: the parameter of all points near the fold lies
        // on one side.
        const bool right = &fold == &folds[0];
        for (const BranchPoint& point : branch.points)
            if (std::abs(point.arclength - fold.arclength) < 0.3)
                CHECK((right ? point.parameter <= fold.parameter : point.parameter >= fold.parameter));
    }
    for (const BranchPoint& point : branch.points)
        if (point.bifurcation == Bifurcation::none)
            CHECK((point.unstable == 1) ==
                  (point.arclength > folds[0].arclength && point.arclength < folds[1].arclength));
}

TEST_CASE("Duffing's hard spring: loss of symmetry, one asymmetric branch, its cascade", "[periodic]") {
    const auto system = models::make_system("duffing");
    VectorXd theta(5);
    theta << 0.1, 0.0, 1.0, 1.0, 1.0;
    ContinuationOptions options;
    options.parameter = 3;
    options.lower = 0.5;
    options.upper = 12.0;
    options.maximum_period = 2;
    const BifurcationDiagram diagram =
        follow_branches(*system, theta, settled(*system, theta, Eigen::Vector2d(0.5, 0.0)), options);
    REQUIRE(diagram.branches.size() == 3);
    const auto crossings = found(diagram.branches[0], Bifurcation::branch_point);
    REQUIRE(crossings.size() == 1);
    CHECK_THAT(crossings[0].orbit.multipliers[0].real(), tests::WithinAbs(1.0, 1e-9));
    CHECK(crossings[0].parameter_error < 1e-10);
    // Half a period later a symmetric orbit is at minus its start: it has one, an asymmetric one has not.
    const auto asymmetry = [&](const BranchPoint& point) {
        VectorXd values = theta;
        values(3) = point.parameter;
        const double durations[] = {std::numbers::pi};
        const VectorXd x = point.orbit.points.col(0);
        return (system->flow(x, 0.0, durations, values, models::Clock::phase).states.col(0) + x).norm();
    };
    for (const BranchPoint& point : diagram.branches[0].points)
        CHECK(asymmetry(point) < 1e-6);
    const Branch& branch = diagram.branches[1];
    CHECK(branch.points.front().parameter == crossings[0].parameter);
    for (std::size_t k = 1; k < branch.points.size(); ++k)
        CHECK(asymmetry(branch.points[k]) > 1e-3);
    CHECK(found(branch, Bifurcation::fold).size() == 2);
    // Orbits that are symmetric have no doublings: their period's map is the square of half a period's.
    CHECK(found(diagram.branches[0], Bifurcation::period_doubling).empty());
    CHECK(found(branch, Bifurcation::period_doubling).size() == 1);
    CHECK(diagram.branches[2].points.front().orbit.period == 2);
}

TEST_CASE("Lorenz at large rho: loss of symmetry and doublings, with and without a section", "[periodic]") {
    const auto system = models::make_system("lorenz");
    VectorXd theta = system->default_parameters();
    theta(1) = 350.0;
    ContinuationOptions options;
    options.parameter = 1;
    options.lower = 210.0;
    options.upper = 360.0;
    options.direction = -1;
    options.maximum_period = 4;
    const double durations[] = {100.0};
    const VectorXd settled_state =
        system->flow(Eigen::Vector3d(20.0, 10.0, 300.0), 0.0, durations, theta, models::Clock::time).states.col(0);
    std::array<std::vector<double>, 2> places;
    for (const bool section : {false, true}) {
        CAPTURE(section);
        StartingSolution start;
        if (section) {
            start.section = models::Section{Eigen::Vector3d::UnitZ(), 349.0, 1};
            start.points = system->crossings(settled_state, *start.section, 2, 10.0, theta).states;
        } else {
            start.points = settled_state;
            start.time = 0.39;
        }
        options.maximum_period = section ? 4 : 2;  // two crossings per turn
        const BifurcationDiagram diagram = follow_branches(*system, theta, start, options);
        REQUIRE(diagram.start_status == OrbitStatus::converged);
        REQUIRE(diagram.branches.size() == 3);
        CHECK(diagram.branches[0].first == BranchEnd::start);
        const auto crossing = found(diagram.branches[0], Bifurcation::branch_point);
        REQUIRE(crossing.size() == 1);
        auto& list = places[section ? 1 : 0];
        list.push_back(crossing[0].parameter);
        for (std::size_t b = 1; b < 3; ++b) {
            const auto doubling = found(diagram.branches[b], Bifurcation::period_doubling);
            REQUIRE(doubling.size() == 1);
            list.push_back(doubling[0].parameter);
            if (section) CHECK(diagram.branches[b].points[1].orbit.period == 1 << b);
        }
        CHECK(diagram.branches[2].points[1].orbit.time > 1.9 * diagram.branches[1].points[1].orbit.time);
    }
    // As the literature gives them, from simulation: 312.97, 229.42, 218.3.
    CHECK_THAT(places[0][0], tests::WithinAbs(312.97, 0.1));
    CHECK_THAT(places[0][1], tests::WithinAbs(229.42, 0.1));
    CHECK_THAT(places[0][2], tests::WithinAbs(218.3, 0.15));
    // Independent of how the orbit is cut: measured 6e-10, times ten.
    for (std::size_t k = 0; k < 3; ++k)
        CHECK_THAT(places[0][k], tests::WithinAbs(places[1][k], 5e-9));
}

TEST_CASE("an autonomous branch ends at an equilibrium, or where T is too long", "[periodic]") {
    const tests::HopfNormalForm system;
    StartingSolution start;
    start.points = Eigen::Vector2d(1.0, 0.0);
    start.time = 6.2;
    ContinuationOptions options;
    options.lower = -1.0;
    options.upper = 4.0;
    BifurcationDiagram diagram = follow_branches(system, system.default_parameters(), start, options);
    REQUIRE(diagram.branches.size() == 1);
    CHECK(diagram.branches[0].first == BranchEnd::equilibrium);
    CHECK(diagram.branches[0].last == BranchEnd::bound);
    // The radius is sqrt(mu): at a thousandth of the scale, 1, mu = 1e-6 or less, and never negative.
    CHECK(diagram.branches[0].points.front().parameter < 1e-6);
    for (const BranchPoint& point : diagram.branches[0].points) {
        CHECK(point.parameter > 0.0);
        CHECK_THAT(point.orbit.points.col(0).norm(), tests::WithinRel(std::sqrt(point.parameter), 1e-6));
        CHECK_THAT(point.orbit.time, tests::WithinRel(2.0 * std::numbers::pi, 1e-10));
    }
    // T = 2 pi / w.
    options.parameter = 1;
    options.lower = 0.01;
    options.upper = 2.0;
    options.direction = -1;
    options.longest = 60.0;
    diagram = follow_branches(system, system.default_parameters(), start, options);
    REQUIRE(diagram.branches.size() == 1);
    CHECK(diagram.branches[0].last == BranchEnd::period_limit);
    const BranchPoint& last = diagram.branches[0].points.back();
    CHECK(last.orbit.time > 60.0);
    CHECK_THAT(last.orbit.time, tests::WithinRel(2.0 * std::numbers::pi / last.parameter, 1e-10));
    // The contraction exp(-2 mu T) has grown from e^-13 to e^-120: further nodes were needed on the way.
    CHECK(last.orbit.points.cols() > 5 * diagram.branches[0].points.front().orbit.points.cols());
}

TEST_CASE("Roessler's cascade", "[periodic]") {
    const auto system = models::make_system("rossler");
    VectorXd theta = system->default_parameters();
    theta(2) = 2.5;
    ContinuationOptions options;
    options.parameter = 2;
    options.lower = 2.0;
    options.upper = 5.7;
    options.maximum_period = 4;
    const double durations[] = {600.0};
    const VectorXd state =
        system->flow(Eigen::Vector3d(1.0, 1.0, 0.0), 0.0, durations, theta, models::Clock::time).states.col(0);
    StartingSolution start;
    start.section = models::Section{Eigen::Vector3d::UnitX(), 0.0, -1};
    start.points = system->crossings(state, *start.section, 1, 100.0, theta).states;
    const BifurcationDiagram diagram = follow_branches(*system, theta, start, options);
    REQUIRE(diagram.branches.size() == 3);
    // At c = 5.7 the orbits of one and two turns are those of tests/reference/rossler_orbits.json. Measured 2e-14
    // of both, times ten.
    CHECK_THAT(diagram.branches[0].points.back().orbit.time, tests::WithinAbs(5.881088455553877, 2e-13));
    CHECK_THAT(diagram.branches[1].points.back().orbit.time, tests::WithinAbs(11.75862607166009, 3e-13));
    for (std::size_t b = 0; b < 3; ++b)
        CHECK(found(diagram.branches[b], Bifurcation::period_doubling).size() == 1);
}

}  // namespace bifurcations_test

#include "periodic/continuation.hpp"

#include <array>
#include <cmath>
#include <vector>

#include "models/registry.hpp"
#include "tests/catch.hpp"

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

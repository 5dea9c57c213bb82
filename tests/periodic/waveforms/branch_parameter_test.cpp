// Branches over a parameter that was measured with an error: Duffing's oscillator around the fold of its resonance.
#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include <fmt/format.h>

#include "estimator/estimate/estimate.hpp"
#include "estimator/interface/random_stream.hpp"
#include "periodic/branches/continuation.hpp"
#include "periodic/waveforms/branch_residual.hpp"
#include "tests/periodic/orbit/steady_state.hpp"
#include "tests/periodic/waveforms/derivative_error.hpp"

namespace branch_parameter_test {

using namespace orbid;
using namespace orbid::tests;
using Eigen::Index;
using Eigen::Vector3d;
using Eigen::VectorXd;
using periodic::BranchOptions;
using periodic::BranchPoint;
using periodic::BranchResidual;
using periodic::MeasuredOrbit;
using periodic::OrbitMeasure;
using periodic::OrbitStatus;
using periodic::StartingSolution;

namespace {

const Vector3d truth(0.1, 0.3, 0.4);
constexpr double omega_sd = 0.01, reading_sd = 0.005;

struct Rig {
    std::shared_ptr<const models::System> system = models::make_system("duffing", "");
    VectorXd values = with_values(
        *system, {{"delta", truth(0)}, {"alpha", 1.0}, {"beta", truth(1)}, {"gamma", truth(2)}, {"omega", 1.4}});
    Index omega = system->parameter_index("omega");
};

/// The branch from 1.4 on over its fold, in steps of at most 1 % of the range.
std::vector<BranchPoint> resonance(const Rig& rig) {
    StartingSolution start;
    start.points = Eigen::Vector2d(1.9, 0.9);
    periodic::ContinuationOptions options;
    options.parameter = rig.omega;
    options.lower = 1.35;
    options.upper = 1.7;
    options.first_step = 1e-3;
    options.largest_step = 1e-2;
    options.solver.maximum_distance = 10.0;
    const auto diagram = periodic::follow_branches(*rig.system, rig.values, start, options);
    REQUIRE(diagram.branches.size() == 1);
    return diagram.branches[0].points;
}

std::size_t fold_of(const std::vector<BranchPoint>& points) {
    const auto fold = std::find_if(points.begin(), points.end(), [](const BranchPoint& point) {
        return point.bifurcation == periodic::Bifurcation::fold && point.parameter > 1.5;
    });
    REQUIRE(fold != points.end());
    return static_cast<std::size_t>(fold - points.begin());
}

BranchOptions options_for(const Rig& rig, double sd) {
    BranchOptions options;
    options.channels.resize(2);
    options.channels[0].scale = {false, reading_sd, estimator::FlatPrior{}};
    options.channels[1] = options.channels[0];
    options.channels[1].measure = OrbitMeasure::rms;
    options.channels[1].coordinate = 1;
    options.parameter = rig.omega;
    options.parameter_sd = sd;
    options.start = truth;
    return options;
}

StartingSolution start_at(const BranchPoint& point) {
    StartingSolution start;
    start.points = point.orbit.points;
    return start;
}

/// A motion with readings of this orbit, at a value of the parameter that may be another one.
MeasuredOrbit motion(const Rig& rig, const BranchPoint& point, double omega) {
    MeasuredOrbit orbit;
    orbit.label = fmt::format("omega = {}", omega);
    VectorXd values = rig.values;
    values(rig.omega) = omega;
    orbit.binding = estimated(*rig.system, values, {"delta", "beta", "gamma"});
    orbit.values = Eigen::Vector2d(point.amplitude.half_range(0), point.amplitude.rms(1));
    orbit.starts = {start_at(point)};
    orbit.starts_at = {point.parameter};
    return orbit;
}

/// Sum of squared deviations from the truth in reported sds, and how many motions are lost.
std::pair<Vector3d, std::size_t> deviations(const BranchResidual& residual) {
    std::vector<estimator::FreeParameter> parameters(3);
    const char* names[] = {"delta", "beta", "gamma"};
    for (std::size_t i = 0; i < 3; ++i) {
        parameters[i].name = names[i];
        parameters[i].start = truth(static_cast<Index>(i));
    }
    const auto estimate = estimator::estimate(parameters, {&residual});
    REQUIRE(estimate.parameters.size() == 3);
    Vector3d off;
    for (std::size_t i = 0; i < 3; ++i)
        off(static_cast<Index>(i)) =
            (estimate.parameters[i].value - truth(static_cast<Index>(i))) / estimate.parameters[i].sd;
    const auto& layout = estimate.active[0].layout;
    return {off, static_cast<std::size_t>(
                     std::count_if(layout.begin(), layout.end(), [](const auto& block) { return !block.active; }))};
}

}  // namespace

TEST_CASE("beyond a fold a motion keeps its orbit, with derivatives at the fold itself", "[periodic][waveform]") {
    const Rig rig;
    const auto points = resonance(rig);
    const BranchPoint& fold = points[fold_of(points)];
    const double beyond = fold.parameter + 0.02;
    const BranchResidual residual(rig.system, {motion(rig, fold, beyond)}, options_for(rig, omega_sd));
    REQUIRE(residual.start_status(0) == OrbitStatus::converged);
    REQUIRE(residual.layout()[0].latents == 1);
    CHECK(residual.structure() == estimator::LatentStructure::independent_blocks);
    CHECK(residual.groups().back().name == "branch.omega");
    CHECK(residual.groups().back().unit == "rad/s");
    const auto latents = residual.initial_latents();
    CHECK(latents[0](0) == 0.0);
    const auto value = residual.evaluate(residual.initial_set(), truth, latents, true);
    REQUIRE(value[0].status == estimator::BlockStatus::ok);
    // The parameter is largest at the fold: slope zero, curvature not.
    CHECK_THAT(value[0].e(2), WithinAbs(beyond - fold.parameter, 1e-9));
    CHECK_THAT(value[0].e_z(2, 0), WithinAbs(0.0, 1e-5));
    for (const double place : {-0.05, 0.05}) {
        const auto moved = residual.evaluate(residual.initial_set(), truth, {VectorXd::Constant(1, place)}, false);
        REQUIRE(moved[0].status == estimator::BlockStatus::ok);
        CHECK(moved[0].e(2) > value[0].e(2) + 1e-5);
    }
    // Sixth-order differences over the fold.
    CHECK(derivative_error(residual, truth, latents, 1e-3) < 1e-7);
}

TEST_CASE("errors in the parameter of a branch: unbiased next to a fold, where exact ones lose motions",
          "[periodic][waveform]") {
    const Rig rig;
    const auto points = resonance(rig);
    const std::size_t fold = fold_of(points);
    constexpr int replicates = 12;
    Vector3d sum = Vector3d::Zero();
    double squares = 0.0, squares_if_exact = 0.0;
    std::size_t lost_if_exact = 0;
    for (int k = 0; k < replicates; ++k) {
        estimator::RandomStream random(7, estimator::RandomPurpose::reading_noise, static_cast<std::uint64_t>(k));
        std::vector<MeasuredOrbit> orbits, exact;
        for (int i = -6; i <= 6; ++i) {
            const BranchPoint& point = points[fold + static_cast<std::size_t>(i + 6) * 2 - 12];
            const double omega = point.parameter + omega_sd * random.normal();
            orbits.push_back(motion(rig, point, omega));
            for (double& reading : orbits.back().values)
                reading += reading_sd * random.normal();
            exact.push_back(orbits.back());
            exact.back().starts_at.clear();
        }
        const auto [off, lost] = deviations(BranchResidual(rig.system, orbits, options_for(rig, omega_sd)));
        CHECK(lost == 0);
        sum += off;
        squares += off.squaredNorm();
        const auto [off_if_exact, now_lost] = deviations(BranchResidual(rig.system, exact, options_for(rig, 0.0)));
        squares_if_exact += off_if_exact.squaredNorm();
        lost_if_exact += now_lost;
    }
    // Normal deviates: their mean within 3.5 sds, the sum of 36 squares below what one run in 10^4 exceeds.
    CHECK(sum.cwiseAbs().maxCoeff() / replicates < 3.5 / std::sqrt(replicates));
    CHECK(squares < 75.0);
    CHECK(lost_if_exact > replicates);
    CHECK(squares_if_exact > 10.0 * squares);
}

}  // namespace branch_parameter_test

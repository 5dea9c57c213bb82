// The bias that latent states give to parameters, by pairs of records drawn anew, against closed forms.

#include "estimator/exploration/bias.hpp"

#include <cmath>
#include <numbers>
#include <string>

#include <tbb/global_control.h>

#include "estimator/exploration/bootstrap.hpp"
#include "estimator/exploration/profile.hpp"
#include "estimator/exploration/tilt.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::bias_test {

using estimator::ErrorDraw;
using estimator::Estimate;
using estimator::EstimateStatus;
using estimator::SimulatedBias;

namespace {

constexpr double radius = 2.0;
constexpr double noise = 0.2;

/// Points on circles at unknown angles, both coordinates read with errors. The best radius is the mean distance from
/// the centre, which is too large by noise^2 / (2 radius) to the second order, however many points there are.
struct Circle {
    FunctionResidual residual;
    std::vector<estimator::FreeParameter> parameters;
    std::vector<estimator::DerivedQuantity> derived;
    estimator::EstimateOptions options;
    Estimate estimate;
    double mean_distance = 0.0;

    /// @param circles  each with so many points.
    Circle(std::size_t points, estimator::Scale scale, Eigen::Index circles = 1) {
        estimator::RandomStream random(7, estimator::RandomPurpose::reading_noise, points);
        residual.add_group(group("e", noise, false));
        for (std::size_t i = 0; i < points * static_cast<std::size_t>(circles); ++i) {
            const auto own = static_cast<Eigen::Index>(i / points);
            const double angle = 2.0 * std::numbers::pi * static_cast<double>(i) / static_cast<double>(points);
            const Eigen::Vector2d y = radius * Eigen::Vector2d(std::cos(angle), std::sin(angle)) +
                                      noise * Eigen::Vector2d(random.normal(), random.normal());
            if (own == 0) mean_distance += y.norm() / static_cast<double>(points);
            estimator::BlockLayout block = layout("point", 2);
            block.latents = 1;
            residual.add_block(
                block,
                [y, own](const Eigen::VectorXd& theta, const Eigen::VectorXd& z, bool) {
                    const Eigen::Vector2d along(std::cos(z[0]), std::sin(z[0]));
                    estimator::BlockValue value;
                    value.e = y - theta[own] * along;
                    value.e_theta = Eigen::MatrixXd::Zero(2, theta.size());
                    value.e_theta.col(own) = -along;
                    value.e_z = theta[own] * Eigen::Vector2d(along[1], -along[0]);
                    return value;
                },
                Eigen::VectorXd::Constant(1, angle));
        }
        parameters = {free_parameter("radius", 1.9)};
        for (Eigen::Index k = 1; k < circles; ++k)
            parameters.push_back(free_parameter("radius_" + std::to_string(k + 1), 1.9));
        for (auto& parameter : parameters)
            parameter.scale = scale;
        derived = {{"area", [](const Eigen::VectorXd& theta) { return std::numbers::pi * theta[0] * theta[0]; },
                    [](const Eigen::VectorXd& theta) {
                        return Eigen::VectorXd(2.0 * std::numbers::pi * theta[0] *
                                               Eigen::VectorXd::Unit(theta.size(), 0));
                    }}};
        options.step_tolerance = 1e-9;
        estimate = estimator::estimate(parameters, {&residual}, derived, options);
    }
    [[nodiscard]] SimulatedBias bias(std::size_t pairs) const {
        return estimator::simulated_bias(parameters, {&residual}, options, estimate, pairs, draws);
    }
    [[nodiscard]] Estimate unbiased(std::size_t pairs) const {
        return estimator::unbiased(parameters, {&residual}, derived, options, estimate, pairs, draws);
    }

    estimator::RecordDrawOptions draws{ErrorDraw::parametric, 3, false};
};

/// To the second order, the distance of a point with errors beyond the radius.
double known_bias(double of_radius) {
    return noise * noise / (2.0 * of_radius);
}

}  // namespace

TEST_CASE("errors of opposite signs are drawn in pairs", "[estimator][bias]") {
    const Circle circle(20, estimator::Scale::linear);
    const estimator::RecordDraws draws({&circle.residual}, circle.estimate, circle.draws);
    const auto one = draws.shifts(4);
    const auto other = draws.shifts(4, estimator::Mirror::opposite);
    for (std::size_t b = 0; b < 20; ++b) {
        const Eigen::VectorXd fitted = circle.estimate.residuals[0][b].e;
        CHECK((one[0][b] + fitted).norm() > 0.0);
        CHECK((one[0][b] + other[0][b] + 2.0 * fitted).norm() < 1e-14);
    }
}

TEST_CASE("added errors leave the record its own, and have a share of their variance", "[estimator][bias]") {
    const Circle circle(20, estimator::Scale::linear);
    estimator::RecordDrawOptions more = circle.draws;
    more.added = 0.25;
    const estimator::RecordDraws anew({&circle.residual}, circle.estimate, circle.draws);
    const estimator::RecordDraws added({&circle.residual}, circle.estimate, more);
    const auto replaced = anew.shifts(4);
    const auto one = added.shifts(4);
    const auto other = added.shifts(4, estimator::Mirror::opposite);
    for (std::size_t b = 0; b < 20; ++b) {
        const Eigen::VectorXd drawn = replaced[0][b] + circle.estimate.residuals[0][b].e;
        CHECK((one[0][b] - 0.5 * drawn).norm() < 1e-14);
        CHECK((one[0][b] + other[0][b]).norm() == 0.0);
    }
}

TEST_CASE("the bias of a circle's radius is known from few pairs", "[estimator][bias]") {
    constexpr std::size_t points = 400;
    const Circle circle(points, estimator::Scale::linear);
    REQUIRE(circle.estimate.status == EstimateStatus::converged);
    const double value = circle.estimate.parameters[0].value;
    CHECK_THAT(value, WithinAbs(circle.mean_distance, 1e-9));
    const SimulatedBias found = circle.bias(8);
    CHECK(found.pairs == 8);
    // Of one point and pair: across^2 / (2 r), whose mean is the bias and whose sd is sqrt(2) of it, halved by the
    // second error of the pair being the same one. Orders beyond the second are (noise / radius)^2 of it.
    const double known = known_bias(value);
    const double error = known * std::sqrt(2.0 / (8.0 * points));
    CHECK_THAT(found.value[0], WithinAbs(known, 4.0 * error + 0.02 * known));
    CHECK(found.error[0] > 0.3 * error);
    CHECK(found.error[0] < 3.0 * error);
    // A tenth of what independent records would leave open.
    CHECK(found.error[0] < 0.1 * noise / std::sqrt(8.0 * points));
    const SimulatedBias single = circle.bias(1);
    CHECK(std::isnan(single.error[0]));
    CHECK_THAT(single.value[0], WithinRel(known, 0.3));
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    CHECK(circle.bias(8).value == found.value);
}

TEST_CASE("a prior holds back half of the bias where it tells half", "[estimator][bias]") {
    Circle circle(400, estimator::Scale::linear);
    const double sd = noise / 20.0;
    circle.parameters[0].prior = estimator::NormalPrior{circle.estimate.parameters[0].value, sd};
    circle.estimate = estimator::estimate(circle.parameters, {&circle.residual}, {}, circle.options);
    const double known = 0.5 * known_bias(circle.estimate.parameters[0].value);
    CHECK_THAT(circle.bias(8).value[0], WithinRel(known, 0.15));
}

TEST_CASE("an estimate less its bias is right, on every scale, and all that follows belongs to it",
          "[estimator][bias]") {
    for (const auto scale : {estimator::Scale::linear, estimator::Scale::log}) {
        const Circle circle(400, scale);
        const Estimate better = circle.unbiased(8);
        CAPTURE(better.message);
        REQUIRE(better.status == EstimateStatus::converged);
        const estimator::Estimated& one = better.parameters[0];
        const double sd = noise / 20.0;
        CHECK_THAT(one.sd, WithinRel(circle.estimate.parameters[0].sd, 5e-3));
        CHECK_THAT(one.bias, WithinAbs(circle.bias(8).value[0], 0.01 * sd));
        CHECK_THAT(one.value + one.bias, WithinAbs(circle.estimate.parameters[0].value, 1e-12));
        CHECK_THAT(0.5 * (one.lower95 + one.upper95), WithinAbs(one.value, 0.02 * sd));
        CHECK_THAT(better.derived[0].value, WithinRel(std::numbers::pi * one.value * one.value, 1e-12));
        // The likelihood falls by half of the squared distance from its maximum.
        const double distance = one.bias / sd;
        CHECK_THAT(circle.estimate.log_likelihood - better.log_likelihood, WithinAbs(0.5 * distance * distance, 1e-3));
        // The objective has ln|H| / 2 of the angles besides, H = (r / noise)^2.
        const double ratio = one.value / circle.estimate.parameters[0].value;
        CHECK_THAT(better.objective - circle.estimate.objective,
                   WithinAbs(0.5 * distance * distance + 400.0 * std::log(ratio), 4e-3));
        CHECK(better.iterations > circle.estimate.iterations);

        // A profile with the tilt lies lower by the bias.
        REQUIRE(better.tilt);
        const auto centre = [&](const Estimate& of, const estimator::EstimateOptions& options) {
            const auto found = estimator::profiles(circle.parameters, {&circle.residual}, options, of, {});
            return 0.5 * (found.at(0).lower + found.at(0).upper);
        };
        estimator::EstimateOptions tilted = circle.options;
        tilted.joint_priors.push_back(*better.tilt);
        CHECK_THAT(centre(circle.estimate, circle.options) - centre(better, tilted), WithinAbs(one.bias, 0.02 * sd));

        // Of replicates the same bias is taken off: what is left is that of the next order.
        estimator::BootstrapOptions asked;
        asked.replicates = 200;
        asked.draws = circle.draws;
        const auto again =
            estimator::bootstrap(circle.parameters, {&circle.residual}, circle.derived, circle.options, better, asked);
        CHECK(std::abs(again.parameters[0].bias) < 4.0 * again.parameters[0].bias_error);
        CHECK(std::abs(again.derived[0].bias) < 4.0 * again.derived[0].bias_error);
        const auto before = estimator::bootstrap(circle.parameters, {&circle.residual}, circle.derived, circle.options,
                                                 circle.estimate, asked);
        CHECK(before.parameters[0].bias > 4.0 * before.parameters[0].bias_error);
    }
}

TEST_CASE("what cannot be corrected stays as it is, and says why", "[estimator][bias]") {
    Circle circle(400, estimator::Scale::linear);
    SECTION("an estimate that has not converged") {
        circle.estimate.status = EstimateStatus::iteration_limit;
        const Estimate same = circle.unbiased(2);
        CHECK(same.parameters[0].value == circle.estimate.parameters[0].value);
        CHECK(same.parameters[0].bias == 0.0);
        CHECK_FALSE(same.tilt);
    }
    SECTION("a bias that is as large as errors are small") {
        Circle large(40000, estimator::Scale::linear);
        const Estimate same = large.unbiased(1);
        CHECK(same.parameters[0].value == large.estimate.parameters[0].value);
        CHECK_THAT(same.message, ContainsSubstring("the bias is not taken off: that of radius is 10 sds"));
        CHECK(same.bias_left == "that of radius is 10 sds");
    }
    SECTION("no pair") {
        const Estimate same = circle.unbiased(0);
        CHECK_THAT(same.message, ContainsSubstring("no pair of records with further errors gave two estimates"));
        CHECK(std::isnan(circle.bias(0).value[0]));
    }
    SECTION("a parameter with a prior") {
        circle.parameters[0].prior = estimator::NormalPrior{2.0, 1.0};
        CHECK_FALSE(circle.unbiased(2).tilt);
        circle.parameters[0].prior = estimator::FlatPrior{};
        circle.options.joint_priors.push_back(
            {{"radius"}, Eigen::VectorXd::Constant(1, 2.0), Eigen::MatrixXd::Ones(1, 1)});
        CHECK_FALSE(circle.unbiased(2).tilt);
    }
    SECTION("a run that is stopped") {
        circle.options.interrupted = [] { return true; };
        const Estimate same = circle.unbiased(2);
        CHECK(same.status == EstimateStatus::interrupted);
        CHECK(same.parameters[0].bias == 0.0);
    }
    SECTION("a bias beyond a bound") {
        circle.parameters[0].lower = circle.estimate.parameters[0].value - 0.002;
        const Estimate same = circle.unbiased(2);
        CHECK_THAT(same.message, ContainsSubstring("the bias is not taken off: all parameters would lie beyond"));
        CHECK_FALSE(same.tilt);
    }
    SECTION("a bias beyond a bound is left to one parameter alone") {
        Circle two(400, estimator::Scale::linear, 2);
        two.parameters[0].lower = two.estimate.parameters[0].value - 0.002;
        const Estimate better = two.unbiased(8);
        CHECK(better.bias_left.empty());
        CHECK(better.parameters[0].bias == 0.0);
        CHECK_THAT(better.parameters[0].value, WithinAbs(two.estimate.parameters[0].value, 1e-6));
        const double known = known_bias(two.estimate.parameters[1].value);
        // Four errors of the mean of 8 pairs, 2.5 % each, and the twentieth of a sd that the slope leaves.
        CHECK_THAT(better.parameters[1].bias, WithinRel(known, 0.15));
    }
    SECTION("a parameter that follows another one has its bias") {
        Circle two(400, estimator::Scale::linear, 2);
        two.parameters[0].start = 1.9;
        two.parameters[0].tied_to = "radius_2";
        two.estimate = estimator::estimate(two.parameters, {&two.residual}, two.derived, two.options);
        const Estimate better = two.unbiased(8);
        CHECK(better.bias_left.empty());
        CHECK(better.parameters[0].value == better.parameters[1].value);
        CHECK(better.parameters[0].bias == better.parameters[1].bias);
        // Two circles: half of the pairs' error, sds smaller by sqrt(2).
        CHECK_THAT(better.parameters[1].bias, WithinRel(known_bias(two.estimate.parameters[1].value), 0.1));
    }
    SECTION("a parameter that is held") {
        circle.parameters[0].lower = circle.parameters[0].upper = circle.parameters[0].start;
        circle.estimate = estimator::estimate(circle.parameters, {&circle.residual}, {}, circle.options);
        const Estimate same = circle.unbiased(2);
        CHECK(same.parameters[0].value == 1.9);
        CHECK_FALSE(same.tilt);
    }
}

TEST_CASE("an estimate again, from where it has ended, is the same", "[estimator][bias]") {
    const Circle circle(50, estimator::Scale::linear);
    const Estimate again = estimator::estimate_again(circle.parameters, {&circle.residual}, circle.derived,
                                                     circle.options, circle.estimate);
    CHECK_THAT(again.parameters[0].value, WithinAbs(circle.estimate.parameters[0].value, 1e-9));
    CHECK_THAT(again.objective, WithinRel(circle.estimate.objective, 1e-12));
    CHECK(again.history.size() >= circle.estimate.history.size());
}

}  // namespace orbid::tests::bias_test

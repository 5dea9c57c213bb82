#include "estimator/problem/tie.hpp"

#include <cmath>
#include <stdexcept>

#include <Eigen/Cholesky>

#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::tie_test {

namespace {

using namespace estimator;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double nan_value = std::numeric_limits<double>::quiet_NaN();

FreeParameter follower(std::string name, std::string leader, double factor = 1.0) {
    FreeParameter parameter = free_parameter(std::move(name), 0.0);
    parameter.tied_to = std::move(leader);
    parameter.tie_factor = factor;
    return parameter;
}

/// y = X (a, b, c) with rows that are not orthogonal.
struct Line {
    MatrixXd x{8, 3};
    VectorXd y{8};
    Line() {
        for (Eigen::Index i = 0; i < 8; ++i) {
            const double t = 0.5 * static_cast<double>(i);
            x.row(i) << 1.0, t, std::sin(t);
            y[i] = 1.0 + 0.5 * t - 0.2 * std::sin(t) + (i % 3 == 0 ? 0.05 : -0.03);
        }
    }
};

}  // namespace

TEST_CASE("tied parameters are one parameter of the estimate", "[estimator][tie]") {
    const Line line;
    FunctionResidual residual;
    residual.add_group(group("y"));
    residual.add_block(layout("data", 8), linear(line.y, line.x));
    const std::vector<FreeParameter> parameters{follower("a", "c", -2.0), free_parameter("b", 0.0),
                                                free_parameter("c", 0.1)};
    const TiedProblem problem = resolve_ties(parameters, {&residual});
    REQUIRE(problem.any());
    REQUIRE(problem.parameters.size() == 2);
    const DerivedQuantity sum{"sum", [](const VectorXd& p) { return p.sum() + p[0] * p[2]; },
                              [](const VectorXd& p) { return VectorXd(Eigen::Vector3d(1.0 + p[2], 1.0, 1.0 + p[0])); }};
    Estimate estimate =
        estimator::estimate(problem.parameters, problem.residuals, problem.derived({sum}), EstimateOptions{});
    REQUIRE(estimate.status == EstimateStatus::converged);
    problem.expand(estimate);
    REQUIRE(estimate.parameters.size() == 3);

    // The same by hand: columns b and c - 2 a.
    MatrixXd design(8, 2);
    design << line.x.col(1), line.x.col(2) - 2.0 * line.x.col(0);
    const Eigen::Vector2d expected = (design.transpose() * design).ldlt().solve(design.transpose() * line.y);
    const auto& p = estimate.parameters;
    CHECK_THAT(p[1].value, WithinRel(expected[0], 1e-10));
    CHECK_THAT(p[2].value, WithinRel(expected[1], 1e-10));
    CHECK(p[0].name == "a");
    CHECK(p[0].value == -2.0 * p[2].value);
    CHECK(p[0].start == -0.2);
    CHECK(p[0].sd == 2.0 * p[2].sd);
    CHECK(p[0].lower95 == -2.0 * p[2].upper95);
    CHECK(p[0].upper95 == -2.0 * p[2].lower95);
    CHECK(p[0].lower95 < p[0].upper95);
    CHECK_THAT(estimate.covariance(0, 0), WithinRel(p[0].sd * p[0].sd, 1e-12));
    CHECK_THAT(estimate.covariance(0, 1), WithinRel(-2.0 * estimate.covariance(2, 1), 1e-14));
    CHECK_THAT(estimate.laplace_covariance(0, 0), WithinRel(p[0].laplace_sd * p[0].laplace_sd, 1e-12));
    CHECK_THAT(estimate.laplace_covariance(0, 1), WithinRel(-2.0 * estimate.laplace_covariance(2, 1), 1e-14));
    CHECK(estimate.correlation(0, 2) == -1.0);
    CHECK(estimate.correlation(0, 1) == -estimate.correlation(2, 1));
    const double a = p[0].value;
    const double c = p[2].value;
    CHECK_THAT(estimate.derived[0].value, WithinRel(a + p[1].value + c + a * c, 1e-14));
    // d sum / d(b, c) = (1, 1 + a - 2 (1 + c)).
    const Eigen::Vector2d gradient(1.0, 1.0 + a - 2.0 * (1.0 + c));
    const MatrixXd covariance = estimate.covariance.bottomRightCorner(2, 2);
    CHECK_THAT(estimate.derived[0].sd, WithinRel(std::sqrt(gradient.dot(covariance * gradient)), 1e-9));
}

TEST_CASE("bounds of a follower hold for the parameter it follows", "[estimator][tie]") {
    FunctionResidual residual;
    std::vector<FreeParameter> parameters{free_parameter("a", 1.0), follower("b", "a", -2.0)};
    parameters[0].lower = 0.0;
    parameters[1].lower = -6.0;
    parameters[1].upper = -1.0;
    const TiedProblem problem = resolve_ties(parameters, {&residual});
    CHECK(problem.parameters[0].lower == 0.5);
    CHECK(problem.parameters[0].upper == 3.0);
    parameters[1].lower = 1.0;
    parameters[1].upper = 2.0;
    CHECK_THROWS_WITH(resolve_ties(parameters, {&residual}), ContainsSubstring("leave \"a\""));
}

TEST_CASE("what a tied parameter inherits at a bound and in directions", "[estimator][tie]") {
    FunctionResidual residual;
    const TiedProblem problem =
        resolve_ties({free_parameter("a", 1.0), follower("b", "a", -2.0), free_parameter("c", 1.0)}, {&residual});
    Estimate estimate;
    estimate.parameters.resize(2);
    estimate.parameters[0].at_bound = estimator::BoundSide::lower;
    estimate.covariance = MatrixXd::Constant(2, 2, nan_value);
    estimate.covariance(1, 1) = 4.0;
    estimate.correlation = MatrixXd::Identity(2, 2);
    estimate.hessian_ratio = Eigen::Vector2d(1.5, 2.5);
    estimate.null_directions.push_back({Eigen::Vector2d(1.0, -0.5)});
    estimate.sloppy_directions.push_back({Eigen::Vector2d(1.0, -0.5), 3.0});
    problem.expand(estimate);
    CHECK(estimate.sloppy_directions[0].components == Eigen::Vector3d(1.0, 0.0, -0.5));
    CHECK(estimate.parameters[0].at_bound == estimator::BoundSide::lower);
    CHECK(estimate.parameters[1].at_bound == estimator::BoundSide::upper);
    CHECK(estimate.covariance(2, 2) == 4.0);
    CHECK(std::isnan(estimate.covariance(1, 2)));
    CHECK(estimate.hessian_ratio == Eigen::Vector3d(1.5, 1.5, 2.5));
    CHECK(estimate.null_directions[0].components == Eigen::Vector3d(1.0, 1.0, -0.5));
}

TEST_CASE("without ties nothing is wrapped", "[estimator][tie]") {
    FunctionResidual residual;
    const TiedProblem problem = resolve_ties({free_parameter("a", 1.0)}, {&residual});
    CHECK_FALSE(problem.any());
    CHECK_FALSE(any_tied(problem.full));
    REQUIRE(problem.residuals.size() == 1);
    CHECK(problem.residuals[0] == &residual);
    CHECK(problem.adapters.empty());
}

TEST_CASE("wrong ties are refused by name", "[estimator][tie]") {
    FunctionResidual residual;
    const auto refused = [&](const std::vector<FreeParameter>& parameters, const std::string& what) {
        CHECK_THROWS_AS(resolve_ties(parameters, {&residual}), std::invalid_argument);
        CHECK_THROWS_WITH(resolve_ties(parameters, {&residual}), ContainsSubstring(what));
    };
    const FreeParameter a = free_parameter("a", 1.0);
    refused({a, follower("b", "b")}, "\"b\": is tied to itself");
    refused({a, follower("b", "x")}, "\"b\": is tied to \"x\", which is not estimated");
    refused({a, follower("b", "c"), follower("c", "a")}, "which itself is tied to \"a\"");
    refused({follower("a", "b"), follower("b", "a")}, "which itself is tied");
    refused({a, follower("b", "a", 0.0)}, "tie_factor = 0");
    refused({a, follower("b", "a", nan_value)}, "tie_factor = nan");
    refused({a, a}, "\"a\" is given twice");
    FreeParameter own = follower("b", "a");
    own.prior = NormalPrior{0.0, 1.0};
    refused({a, own}, "\"b\": has a prior of its own");
    const JointNormalPrior joint{{"a", "b"}, VectorXd::Zero(2), MatrixXd::Identity(2, 2)};
    CHECK_THROWS_WITH(resolve_ties({a, follower("b", "a")}, {&residual}, {joint}),
                      ContainsSubstring("\"b\": is in a joint prior"));
    CHECK_THROWS_WITH(resolve_ties({a, follower("b", "a")}, {nullptr}), ContainsSubstring("residuals[0] is null"));
}

TEST_CASE("bounds that leave one value hold a parameter", "[estimator][tie]") {
    const Line line;
    FunctionResidual residual;
    residual.add_group(group("y"));
    residual.add_block(layout("data", 8), linear(line.y, line.x));
    std::vector<FreeParameter> parameters{free_parameter("a", 0.3), free_parameter("b", 0.7), free_parameter("c", 0.1)};
    parameters[1].lower = parameters[1].upper = parameters[1].start;
    REQUIRE(any_tied(parameters));
    const DerivedQuantity sum{"sum", [](const VectorXd& p) { return p.sum(); },
                              [](const VectorXd& p) { return VectorXd(VectorXd::Ones(p.size())); }};
    const Estimate estimate = estimator::estimate(parameters, {&residual}, {sum}, EstimateOptions{});
    REQUIRE(estimate.status == EstimateStatus::converged);
    REQUIRE(estimate.parameters.size() == 3);
    CHECK(estimate.parameters[1].value == 0.7);
    CHECK(std::isnan(estimate.parameters[1].sd));
    CHECK(estimate.parameters[1].interval_method == IntervalMethod::fixed);
    // Least squares of what is left.
    MatrixXd x(8, 2);
    x << line.x.col(0), line.x.col(2);
    const VectorXd right = line.y - 0.7 * line.x.col(1);
    const MatrixXd inverse = (x.transpose() * x).inverse();
    const VectorXd best = inverse * x.transpose() * right;
    CHECK_THAT(estimate.parameters[0].value, WithinAbs(best[0], 1e-8));
    CHECK_THAT(estimate.parameters[2].value, WithinAbs(best[1], 1e-8));
    const double variance = (right - x * best).squaredNorm() / 6.0;
    CHECK_THAT(estimate.parameters[2].sd, WithinRel(std::sqrt(variance * inverse(1, 1)), 1e-6));
    CHECK_THAT(estimate.covariance(0, 2), WithinRel(variance * inverse(0, 1), 1e-6));
    CHECK(std::isnan(estimate.covariance(0, 1)));
    CHECK_THAT(estimate.derived[0].value, WithinAbs(best.sum() + 0.7, 1e-8));
    CHECK_THAT(estimate.derived[0].sd, WithinRel(std::sqrt(variance * inverse.sum()), 1e-6));
    // Its follower is held as well, and a part of the estimate forgets both.
    parameters.push_back(follower("d", "b", 2.0));
    const TiedProblem problem = resolve_ties(parameters, {&residual});
    REQUIRE(problem.parameters.size() == 2);
    CHECK(problem.map.expand(VectorXd::Zero(2))[3] == 1.4);
    const Estimate part = resolve_ties({parameters.begin(), parameters.end() - 1}, {&residual}).reduced(estimate);
    REQUIRE(part.parameters.size() == 2);
    CHECK(part.parameters[1].name == "c");
    CHECK(part.covariance(0, 1) == estimate.covariance(0, 2));
}

}  // namespace orbid::tests::tie_test

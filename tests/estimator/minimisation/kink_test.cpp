// Objectives with kinks, as dry friction makes them where motion begins to stick: minima known on paper.

#include <algorithm>
#include <cmath>

#include "estimator/minimisation/gradient_bundle.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::kink_test {

namespace {

using Residuals = std::function<Eigen::VectorXd(const Eigen::VectorXd& theta)>;
using Slopes = std::function<Eigen::MatrixXd(const Eigen::VectorXd& theta)>;

/// Residuals with errors of sd 1.
FunctionResidual with_unit_errors(int records, Residuals residuals, Slopes slopes) {
    FunctionResidual residual;
    residual.add_group(group("y", 1.0, false));
    residual.add_block(layout("all", records),
                       [residuals = std::move(residuals), slopes = std::move(slopes), records](
                           const Eigen::VectorXd& theta, const Eigen::VectorXd&, bool derivatives) {
                           estimator::BlockValue value;
                           value.e = residuals(theta);
                           if (derivatives) value.e_theta = slopes(theta);
                           value.e_z.resize(records, 0);
                           return value;
                       });
    return residual;
}

}  // namespace

TEST_CASE("a minimum at a kink of one parameter converges and says so", "[estimator][kink]") {
    // 1/2 (2 - x)^2 + 1/2 (-3 - 10 max(x - 1, 0))^2: falls with slope -1 up to x = 1, rises with slope 29 behind it.
    FunctionResidual residual = with_unit_errors(
        2,
        [](const Eigen::VectorXd& x) {
            return Eigen::VectorXd(Eigen::Vector2d(2.0 - x[0], -3.0 - 10.0 * std::max(x[0] - 1.0, 0.0)));
        },
        [](const Eigen::VectorXd& x) { return Eigen::MatrixXd(Eigen::Vector2d(-1.0, x[0] > 1.0 ? -10.0 : 0.0)); });
    const auto result = estimator::estimate({free_parameter("x", 0.2)}, {&residual});
    CAPTURE(result.message);
    CHECK(result.status == estimator::EstimateStatus::converged);
    CHECK_THAT(result.message, ContainsSubstring("the minimum lies at a kink of the objective"));
    // Pieces within 1e-3 sds count, and the sd is 1 on the flat side.
    CHECK_THAT(result.parameters[0].value, WithinAbs(1.0, 1e-3));
    CHECK_FALSE(result.trust_normal);
    CHECK_THAT(result.distrust, ContainsSubstring("kink"));
    CHECK(result.remaining < 1e-3);
}

TEST_CASE("a minimum before a jump converges only if less than one sd lies beyond", "[estimator][kink]") {
    // 1/2 (x_0 - x)^2, and 3^2 / 2 more behind x = 1: a block that sticks from there on.
    const auto least = [](double x_0) {
        FunctionResidual residual = with_unit_errors(
            2,
            [x_0](const Eigen::VectorXd& x) {
                return Eigen::VectorXd(Eigen::Vector2d(x_0 - x[0], x[0] > 1.0 ? 3.0 : 0.0));
            },
            [](const Eigen::VectorXd&) { return Eigen::MatrixXd(Eigen::Vector2d(-1.0, 0.0)); });
        return estimator::estimate({free_parameter("x", 0.2)}, {&residual});
    };
    const auto near = least(1.5);
    CAPTURE(near.message);
    CHECK(near.status == estimator::EstimateStatus::converged);
    CHECK_THAT(near.message, ContainsSubstring("the objective jumps by 4.5 where it is least"));
    CHECK_THAT(near.parameters[0].value, WithinAbs(1.0, 1e-3));
    CHECK_THAT(near.remaining, WithinAbs(0.5, 1e-3));
    CHECK_FALSE(near.trust_normal);
    const auto far = least(3.0);
    CAPTURE(far.message);
    CHECK(far.status == estimator::EstimateStatus::no_progress);
}

TEST_CASE("wrong derivatives are no kink", "[estimator][kink]") {
    FunctionResidual residual = with_unit_errors(
        1, [](const Eigen::VectorXd& x) { return Eigen::VectorXd::Constant(1, 2.0 - x[0]); },
        [](const Eigen::VectorXd&) { return Eigen::MatrixXd::Constant(1, 1, 1.0); });
    const auto result = estimator::estimate({free_parameter("x", 0.2)}, {&residual});
    CHECK(result.status == estimator::EstimateStatus::no_progress);
    CHECK_THAT(result.message, ContainsSubstring("no step decreases the objective"));
}

TEST_CASE("the least convex combination against closed forms", "[estimator][kink]") {
    using estimator::least_convex_combination;
    // One vector; two that oppose each other, |a| = 1, |b| = 2; two alike, of which the shorter is the least.
    CHECK(least_convex_combination(Eigen::MatrixXd::Constant(1, 1, 3.0))[0] == 1.0);
    Eigen::Matrix2d opposed;
    opposed << 1.0, -2.0, -2.0, 4.0;
    CHECK_THAT(least_convex_combination(opposed)[0], WithinAbs(2.0 / 3.0, 1e-9));
    Eigen::Matrix2d alike;
    alike << 1.0, 2.0, 2.0, 4.0;
    CHECK_THAT(least_convex_combination(alike)[0], WithinAbs(1.0, 1e-12));
    // Corners of a triangle about the origin: its barycentric coordinates there, 1/2, 1/4, 1/4.
    Eigen::Matrix<double, 2, 3> corners;
    corners << 1.0, -1.0, -1.0, 0.0, 1.0, -1.0;
    const Eigen::VectorXd share = least_convex_combination(corners.transpose() * corners);
    CHECK_THAT(share[0], WithinAbs(0.5, 1e-6));
    CHECK_THAT(share[1], WithinAbs(0.25, 1e-6));
}

}  // namespace orbid::tests::kink_test

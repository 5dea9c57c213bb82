#include <cmath>
#include <random>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "estimator/estimate/estimate.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::linear_test {

namespace {

struct Regression {
    Eigen::MatrixXd x;
    Eigen::VectorXd y;
};

Regression made_regression(Eigen::Index n, double sd, unsigned seed) {
    std::mt19937_64 generator(seed);
    std::normal_distribution<double> normal;
    Regression data{Eigen::MatrixXd(n, 3), Eigen::VectorXd(n)};
    for (Eigen::Index i = 0; i < n; ++i) {
        const double t = static_cast<double>(i) / static_cast<double>(n - 1);
        data.x.row(i) << 1.0, t, t * t;
        data.y[i] = 1.0 - 2.0 * t + 0.5 * t * t + sd * normal(generator);
    }
    return data;
}

std::vector<estimator::FreeParameter> three() {
    return {free_parameter("a", 10.0), free_parameter("b", 10.0), free_parameter("c", -10.0)};
}

void check_history(const estimator::Estimate& result) {
    REQUIRE_FALSE(result.history.empty());
    for (const estimator::StepRecord& step : result.history) {
        CAPTURE(step.block, step.round, step.before, step.after);
        if (step.accepted) CHECK(step.after <= step.before);
        if (!step.accepted) CHECK(step.reason != estimator::StepRejection::none);
    }
}

}  // namespace

TEST_CASE("linear regression: closed form of theta, scale, covariance and t interval", "[estimator]") {
    const Regression data = made_regression(20, 0.1, 1);
    const Eigen::MatrixXd inverse = (data.x.transpose() * data.x).inverse();
    const Eigen::VectorXd theta = inverse * data.x.transpose() * data.y;
    const double m = (data.y - data.x * theta).squaredNorm();
    for (const auto variance : {estimator::Variance::restricted, estimator::Variance::ml}) {
        FunctionResidual residual;
        residual.add_group(group("y"));
        residual.add_block(layout("data", 20), linear(data.y, data.x));
        estimator::EstimateOptions options;
        options.variance = variance;
        estimator::DerivedQuantity sum{
            "sum", [](const Eigen::VectorXd& t) { return t.sum(); },
            [](const Eigen::VectorXd& t) { return Eigen::VectorXd(Eigen::VectorXd::Ones(t.size())); }};
        const auto result = estimator::estimate(three(), {&residual}, {sum}, options);
        CAPTURE(result.message);
        REQUIRE(result.status == estimator::EstimateStatus::converged);
        const double divisor = variance == estimator::Variance::restricted ? 17.0 : 20.0;
        const double s = std::sqrt(m / divisor);
        // Rounding through a condition number of about 40: measured below 1e-13, bounds ten times that.
        CHECK_THAT(result.scales[0].value, WithinRel(s, 1e-12));
        // Information of ln s is 2 (n - q) or 2 n.
        CHECK_THAT(result.scales[0].uncertainty, WithinRel(s / std::sqrt(2.0 * divisor), 1e-11));
        // 97.5 % quantile of t with 17 degrees of freedom, standard tables.
        constexpr double t17 = 2.109815577833181;
        for (Eigen::Index i = 0; i < 3; ++i) {
            const auto& parameter = result.parameters[static_cast<std::size_t>(i)];
            const double sd = s * std::sqrt(inverse(i, i));
            CHECK_THAT(parameter.value, WithinRel(theta[i], 1e-11));
            CHECK_THAT(parameter.sd, WithinRel(sd, 1e-11));
            // The t statistic takes m / 17, whichever scale is reported.
            const double half_width = t17 * std::sqrt(m / 17.0 * inverse(i, i));
            CHECK_THAT(parameter.upper95 - parameter.value, WithinRel(half_width, 1e-10));
            CHECK(parameter.interval_method == estimator::IntervalMethod::t);
            CHECK(parameter.data_share == 1.0);
        }
        CHECK_THAT(result.covariance(0, 1), WithinRel(s * s * inverse(0, 1), 1e-10));
        CHECK_THAT(result.derived[0].sd, WithinRel(s * std::sqrt(inverse.sum()), 1e-9));
        CHECK_THAT(result.degrees_of_freedom, WithinAbs(17.0, 0.0));
        CHECK(result.trust_normal);
        CHECK_THAT(result.log_likelihood,
                   WithinRel(-10.0 * std::log(2.0 * M_PI) - 20.0 * std::log(s) - 0.5 * m / (s * s), 1e-12));
        check_history(result);
    }
}

TEST_CASE("without error uncertainties the estimate is the same, and its intervals are normal", "[estimator]") {
    const Regression data = made_regression(20, 0.1, 1);
    FunctionResidual residual;
    residual.add_group(group("y"));
    residual.add_block(layout("data", 20), linear(data.y, data.x));
    estimator::EstimateOptions options;
    const auto whole = estimator::estimate(three(), {&residual}, {}, options);
    options.error_uncertainties = false;
    const auto quick = estimator::estimate(three(), {&residual}, {}, options);
    for (std::size_t i = 0; i < 3; ++i) {
        CHECK(quick.parameters[i].value == whole.parameters[i].value);
        CHECK_THAT(quick.parameters[i].sd, WithinRel(whole.parameters[i].sd, 1e-14));
        CHECK(quick.parameters[i].interval_method == estimator::IntervalMethod::normal);
        CHECK_THAT(quick.parameters[i].upper95,
                   WithinRel(quick.parameters[i].value + 1.959963984540054 * quick.parameters[i].sd, 1e-12));
    }
    REQUIRE(quick.scales.size() == 1);
    CHECK(quick.scales[0].value == whole.scales[0].value);
    CHECK(whole.scales[0].uncertainty > 0.0);
    CHECK(std::isnan(quick.scales[0].uncertainty));
    CHECK(quick.objective == whole.objective);
}

TEST_CASE("a fixed scale gives normal intervals and generalised least squares under a covariance shape",
          "[estimator]") {
    const Regression data = made_regression(12, 0.1, 2);
    Eigen::MatrixXd shape(12, 12);
    for (Eigen::Index i = 0; i < 12; ++i)
        for (Eigen::Index j = 0; j < 12; ++j)
            shape(i, j) = std::pow(0.7, std::abs(static_cast<double>(i - j)));
    FunctionResidual residual;
    residual.add_group(group("y", 0.1, false));
    auto block = layout("data", 12);
    block.shape = shape;
    residual.add_block(block, linear(data.y, data.x));
    const auto result = estimator::estimate(three(), {&residual});
    const Eigen::MatrixXd weight = shape.inverse() / 0.01;
    const Eigen::MatrixXd inverse = (data.x.transpose() * weight * data.x).inverse();
    const Eigen::VectorXd theta = inverse * data.x.transpose() * weight * data.y;
    REQUIRE(result.status == estimator::EstimateStatus::converged);
    for (Eigen::Index i = 0; i < 3; ++i) {
        const auto& parameter = result.parameters[static_cast<std::size_t>(i)];
        CHECK_THAT(parameter.value, WithinRel(theta[i], 1e-10));
        CHECK_THAT(parameter.sd, WithinRel(std::sqrt(inverse(i, i)), 1e-10));
        CHECK(parameter.interval_method == estimator::IntervalMethod::normal);
        CHECK_THAT((parameter.upper95 - parameter.value) / parameter.sd, WithinRel(1.959963984540054, 1e-9));
    }
    CHECK_THAT(result.scales[0].uncertainty, WithinAbs(0.0, 0.0));
}

// Two channels that share the parameters: stationarity of the restricted likelihood, iterated independently with dense
// matrices, s_g^2 = (M_g + tr(X_g C X_g^T)) / n_g.
TEST_CASE("two groups with different scales", "[estimator]") {
    const Regression first = made_regression(15, 0.05, 3);
    const Regression second = made_regression(25, 1.0, 4);
    for (const bool coupled : {false, true}) {
        // Coupled: the first five records of both channels are correlated in one block.
        FunctionResidual residual;
        residual.add_group(group("fine"));
        residual.add_group(group("coarse"));
        Eigen::MatrixXd x(40, 3);
        x << first.x, second.x;
        Eigen::VectorXd y(40);
        y << first.y, second.y;
        Eigen::MatrixXd sigma = Eigen::MatrixXd::Identity(40, 40);
        if (coupled)
            for (Eigen::Index i = 0; i < 5; ++i)
                sigma(i, 15 + i) = sigma(15 + i, i) = 0.6;
        auto block = layout("both", 40);
        for (std::size_t i = 15; i < 40; ++i)
            block.group[i] = 1;
        if (coupled) block.shape = sigma;
        residual.add_block(block, linear(y, x));
        const auto result = estimator::estimate(three(), {&residual});
        CAPTURE(coupled, result.message);
        REQUIRE(result.status == estimator::EstimateStatus::converged);
        CHECK(result.parameters[0].interval_method == estimator::IntervalMethod::satterthwaite);
        check_history(result);
        // Independent check: gradient of the restricted likelihood by central differences of its dense definition.
        const auto criterion = [&](double ln_fine, double ln_coarse) {
            Eigen::VectorXd d(40);
            d.head(15).setConstant(std::exp(ln_fine));
            d.tail(25).setConstant(std::exp(ln_coarse));
            const Eigen::MatrixXd v = d.asDiagonal() * sigma * d.asDiagonal();
            const Eigen::MatrixXd w = v.inverse();
            const Eigen::MatrixXd h = x.transpose() * w * x;
            const Eigen::VectorXd theta = h.ldlt().solve(x.transpose() * w * y);
            const Eigen::VectorXd e = y - x * theta;
            return 0.5 * (std::log(v.determinant()) + e.dot(w * e) + std::log(h.determinant()));
        };
        const double a = std::log(result.scales[0].value);
        const double b = std::log(result.scales[1].value);
        const double step = 1e-4;
        // Second derivatives are about 2 n, so 1e-6 in the gradient is 3e-8 in ln s; differences are good to 1e-7.
        CHECK_THAT((criterion(a + step, b) - criterion(a - step, b)) / (2.0 * step), WithinAbs(0.0, 1e-6));
        CHECK_THAT((criterion(a, b + step) - criterion(a, b - step)) / (2.0 * step), WithinAbs(0.0, 1e-6));
        CHECK_THAT(result.objective, WithinRel(criterion(a, b), 1e-10));
    }
}

// Balanced one-way layout y_ij = mu + a_i + e_ij with free a_i (mu fixed at none): REML variance within = SSW / (N -
// k).
TEST_CASE("independent latent blocks: variance within a one-way layout", "[estimator]") {
    std::mt19937_64 generator(5);
    std::normal_distribution<double> normal;
    const Eigen::Index blocks = 12;
    const Eigen::Index size = 4;
    for (const auto variance : {estimator::Variance::restricted, estimator::Variance::ml}) {
        FunctionResidual residual;
        residual.add_group(group("y"));
        double within = 0.0;
        double slope_xx = 0.0;
        double slope_xy = 0.0;
        std::vector<std::pair<Eigen::VectorXd, Eigen::VectorXd>> kept;
        for (Eigen::Index b = 0; b < blocks; ++b) {
            Eigen::VectorXd y(size);
            Eigen::VectorXd x(size);
            const double own = 3.0 * normal(generator);
            for (Eigen::Index i = 0; i < size; ++i) {
                x[i] = normal(generator);
                y[i] = own + 0.7 * x[i] + 0.2 * normal(generator);
            }
            auto block = layout("block " + std::to_string(b), size);
            block.latents = 1;
            residual.add_block(block, linear(y, x, Eigen::MatrixXd::Ones(size, 1)), Eigen::VectorXd::Zero(1));
            const Eigen::VectorXd cx = x.array() - x.mean();
            const Eigen::VectorXd cy = y.array() - y.mean();
            slope_xx += cx.squaredNorm();
            slope_xy += cx.dot(cy);
            kept.emplace_back(cx, cy);
        }
        const double slope = slope_xy / slope_xx;
        for (const auto& [cx, cy] : kept)
            within += (cy - slope * cx).squaredNorm();
        estimator::EstimateOptions options;
        options.variance = variance;
        const auto result = estimator::estimate({free_parameter("slope", 0.0)}, {&residual}, {}, options);
        CAPTURE(result.message);
        REQUIRE(result.status == estimator::EstimateStatus::converged);
        // Latent states are integrated out in both; theta only when restricted.
        const double degrees =
            static_cast<double>(blocks * (size - 1)) - (variance == estimator::Variance::restricted ? 1.0 : 0.0);
        const double s = std::sqrt(within / degrees);
        CHECK_THAT(result.scales[0].value, WithinRel(s, 1e-11));
        CHECK_THAT(result.parameters[0].value, WithinRel(slope, 1e-11));
        CHECK_THAT(result.parameters[0].sd, WithinRel(s / std::sqrt(slope_xx), 1e-11));
        CHECK_THAT(result.degrees_of_freedom, WithinAbs(static_cast<double>(blocks * (size - 1)) - 1.0, 0.0));
        check_history(result);
    }
}

}  // namespace orbid::tests::linear_test

#include "estimator/uncertainty/residual_diagnostic.hpp"

#include <cmath>
#include <fstream>
#include <numbers>

#include <nlohmann/json.hpp>

#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace orbid::tests::residual_diagnostic_test {

namespace {

// R 4.2.2; made by tests/reference/residual_diagnostics.R.
nlohmann::json reference() {
    std::ifstream file(orbid::tests::source_folder() + "/tests/reference/residual_diagnostics.json");
    REQUIRE(file);
    return nlohmann::json::parse(file);
}

Eigen::VectorXd vector(const nlohmann::json& list) {
    Eigen::VectorXd result(static_cast<Eigen::Index>(list.size()));
    for (std::size_t i = 0; i < list.size(); ++i)
        result[static_cast<Eigen::Index>(i)] = list[i].get<double>();
    return result;
}

// Statistics: worst measured 7e-14, probabilities 5e-12 (both for the runs of n = 272, whose reference sums the
// distribution); bounds ten times that. R forms 1 - p in places: small probabilities are known to 1e-16 only.
void check(const estimator::TestResult& result, const nlohmann::json& expected) {
    CHECK_THAT(result.statistic, WithinRel(expected[0].get<double>(), 7e-13));
    const double p = expected[1].get<double>();
    CHECK_THAT(result.p, WithinAbs(p, 1e-15 + 5e-11 * p));
}

Eigen::VectorXd normal_scores(Eigen::Index n) {
    // Logistic quantiles at (i - 1/2) / n, scaled to look normal: symmetric, tails a little long.
    Eigen::VectorXd x(n);
    for (Eigen::Index i = 0; i < n; ++i) {
        const double p = (static_cast<double>(i) + 0.5) / static_cast<double>(n);
        x[i] = std::log(p / (1.0 - p)) / 1.702;
    }
    return x;
}

}  // namespace

TEST_CASE("residual diagnostics of three fits agree with R", "[estimator][reference]") {
    const nlohmann::json table = reference();
    for (const std::string name : {"stackloss", "lake_huron", "faithful"}) {
        CAPTURE(name);
        const nlohmann::json& fit = table.at(name);
        estimator::ResidualSample sample;
        // Any unit will do: the scale is estimated from the residuals.
        sample.residual = 7.0 * vector(fit.at("residual"));
        sample.leverage = vector(fit.at("leverage"));
        sample.sequences = {sample.residual.size()};
        const auto result = estimator::diagnose(sample, {.lags = 5});
        CHECK(result.count == sample.residual.size());
        check(result.anderson_darling, fit.at("anderson_darling"));
        check(result.shapiro_wilk, fit.at("shapiro_wilk"));
        check(result.skewness_test, fit.at("skewness"));
        check(result.kurtosis_test, fit.at("kurtosis"));
        check(result.ljung_box, fit.at("ljung_box_5"));
        check(result.runs, fit.at("runs"));
        const Eigen::VectorXd studentised = vector(fit.at("rstudent"));
        const Eigen::VectorXd cook = vector(fit.at("cook"));
        // 17 printed digits of residuals and leverages: measured 3e-16 relative to the largest.
        CHECK((result.studentised - studentised).cwiseAbs().maxCoeff() < 3e-15 * studentised.cwiseAbs().maxCoeff());
        for (const estimator::Influence& record : result.influential)
            CHECK_THAT(record.cook, WithinRel(cook[record.record], 1.3e-14));
        const auto beyond = (cook.array() > 4.0 / static_cast<double>(cook.size())).count();
        CHECK(result.influential.size() == static_cast<std::size_t>(std::min<Eigen::Index>(beyond, 10)));
    }
}

TEST_CASE("the known outlier of the stack loss data leads its lists", "[estimator][reference]") {
    const nlohmann::json fit = reference().at("stackloss");
    estimator::ResidualSample sample{vector(fit.at("residual")), {}, vector(fit.at("leverage")), 0.0, true};
    // Record 21 (index 20): Cook's distance 0.69 and studentised -3.33, the figures every textbook prints.
    const auto result = estimator::diagnose(sample, {.outlier_level = 0.2});
    REQUIRE_FALSE(result.influential.empty());
    CHECK(result.influential.front().record == 20);
    CHECK_THAT(result.influential.front().cook, WithinAbs(0.692, 5e-4));
    REQUIRE(result.outliers.size() == 1);
    CHECK(result.outliers.front().record == 20);
    CHECK_THAT(result.outliers.front().studentised, WithinAbs(-3.330, 5e-4));
    // R: 21 * 2 * pt(-3.330493, 16).
    CHECK_THAT(result.outliers.front().p, WithinAbs(0.0891, 2e-4));
    CHECK(std::isnan(result.lag1));
    CHECK(std::isnan(result.ljung_box.p));
    CHECK(std::isnan(result.runs.p));
    sample.scale_estimated = false;
    const auto known = estimator::diagnose(sample);
    // Against a known sd of 1 the residual itself counts.
    CHECK_THAT(known.studentised[20], WithinRel(sample.residual[20] / std::sqrt(1.0 - sample.leverage[20]), 1e-13));
    CHECK(known.outliers.front().record == 20);
}

TEST_CASE("Shapiro and Wilk's W from three to twelve values", "[estimator][reference]") {
    const nlohmann::json table = reference().at("shapiro_wilk_of_squares");
    REQUIRE(table.size() == 10);
    for (const nlohmann::json& row : table) {
        const int n = row[0].get<int>();
        CAPTURE(n);
        Eigen::VectorXd x(n);
        for (int i = 0; i < n; ++i)
            x[i] = (i + 1.0) * (i + 1.0);
        const auto result = estimator::shapiro_wilk(x);
        CHECK_THAT(result.statistic, WithinRel(row[1].get<double>(), 5e-15));
        CHECK_THAT(result.p, WithinRel(row[2].get<double>(), 1e-13));
        // The order of the values is of no account.
        CHECK_THAT(estimator::shapiro_wilk(x.reverse()).p, WithinRel(result.p, 1e-12));
    }
}

TEST_CASE("alternating, constant-sign and pooled sequences", "[estimator]") {
    // + - + - ...: 10 runs where 6 are expected, with variance 50 (50 - 10) / (100 * 9) = 20 / 9.
    Eigen::VectorXd alternating(10);
    for (Eigen::Index i = 0; i < 10; ++i)
        alternating[i] = i % 2 == 0 ? 1.0 : -1.0;
    const double z = 4.0 / std::sqrt(20.0 / 9.0);
    CHECK_THAT(estimator::runs_test({alternating}).statistic, WithinRel(z, 1e-14));
    CHECK_THAT(estimator::runs_test({alternating}).p, WithinRel(std::erfc(z / std::numbers::sqrt2), 1e-14));
    // Two independent sequences: sums of numbers, means and variances.
    CHECK_THAT(estimator::runs_test({alternating, alternating}).statistic, WithinRel(std::sqrt(2.0) * z, 1e-14));
    CHECK(std::isnan(estimator::runs_test({Eigen::VectorXd::Ones(10)}).p));
    // r_1 = -9/10 in closed form: Q = 10 * 12 * 0.81 / 9; cutting it in two loses one pair.
    CHECK_THAT(estimator::ljung_box({alternating}, 1).statistic, WithinRel(120.0 * 0.81 / 9.0, 1e-14));
    CHECK_THAT(estimator::ljung_box({alternating.head(4), alternating.tail(6)}, 1).statistic,
               WithinRel(120.0 * 0.64 / 8.0, 1e-14));
    CHECK(std::isnan(estimator::ljung_box({alternating}, 9).p));
    CHECK(std::isnan(estimator::ljung_box({Eigen::VectorXd::Zero(10)}, 1).p));
}

TEST_CASE("diagnostics of nearly normal values see nothing; too few or equal values are undefined", "[estimator]") {
    estimator::ResidualSample sample;
    sample.residual = normal_scores(200);
    const auto result = estimator::diagnose(sample);
    CHECK(result.anderson_darling.p > 0.5);
    CHECK(result.outliers.empty());
    CHECK(result.leverages.empty());
    CHECK_THAT(result.mean, WithinAbs(0.0, 1e-14));
    sample.residual = Eigen::VectorXd::Constant(50, 0.3);
    const auto constant = estimator::diagnose(sample);
    CHECK(std::isnan(constant.anderson_darling.p));
    CHECK(std::isnan(constant.shapiro_wilk.p));
    CHECK(std::isnan(constant.skewness_test.p));
    sample.residual = Eigen::VectorXd::LinSpaced(7, -1.0, 1.0);
    const auto few = estimator::diagnose(sample);
    CHECK(std::isnan(few.anderson_darling.p));
    CHECK(std::isnan(few.kurtosis_test.p));
    CHECK(few.shapiro_wilk.p > 0.5);
    sample.residual.resize(0);
    CHECK(estimator::diagnose(sample).count == 0);
}

TEST_CASE("residual diagnostics refuse what makes no sense", "[estimator]") {
    estimator::ResidualSample sample;
    sample.residual = Eigen::VectorXd::LinSpaced(10, -1.0, 1.0);
    sample.leverage = Eigen::VectorXd::Constant(10, 0.1);
    CHECK_NOTHROW(estimator::diagnose(sample));
    auto wrong = sample;
    wrong.residual[3] = std::nan("");
    CHECK_THROWS_AS(estimator::diagnose(wrong), std::invalid_argument);
    wrong = sample;
    wrong.leverage[2] = 1.5;
    CHECK_THROWS_AS(estimator::diagnose(wrong), std::invalid_argument);
    wrong = sample;
    wrong.leverage.resize(4);
    wrong.leverage.setZero();
    CHECK_THROWS_AS(estimator::diagnose(wrong), std::invalid_argument);
    wrong = sample;
    wrong.sequences = {4, 5};
    CHECK_THROWS_AS(estimator::diagnose(wrong), std::invalid_argument);
    wrong = sample;
    wrong.fitted = -1.0;
    CHECK_THROWS_AS(estimator::diagnose(wrong), std::invalid_argument);
    CHECK_THROWS_AS(estimator::diagnose(sample, {.lags = -1}), std::invalid_argument);
    CHECK_THROWS_AS(estimator::diagnose(sample, {.outlier_level = 1.0}), std::invalid_argument);
    // A record that is fitted exactly whatever it reads has nothing to be studentised.
    sample.leverage[0] = 1.0;
    CHECK(std::isnan(estimator::diagnose(sample).studentised[0]));
}

}  // namespace orbid::tests::residual_diagnostic_test

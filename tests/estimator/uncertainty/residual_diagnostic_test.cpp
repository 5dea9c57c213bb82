#include "estimator/uncertainty/residual_diagnostic.hpp"

#include <cmath>
#include <fstream>
#include <numbers>

#include <boost/math/distributions/students_t.hpp>
#include <nlohmann/json.hpp>

#include "estimator/uncertainty/autocorrelation.hpp"
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
        sample.sequences = {sample.residual.size()};
        const auto result = estimator::diagnose(sample);
        CHECK(result.count == sample.residual.size());
        check(result.anderson_darling, fit.at("anderson_darling"));
        check(result.shapiro_wilk, fit.at("shapiro_wilk"));
        check(result.skewness_test, fit.at("skewness"));
        check(result.kurtosis_test, fit.at("kurtosis"));
        check(estimator::ljung_box({sample.residual}, 5), fit.at("ljung_box_5"));
        check(result.runs, fit.at("runs"));
    }
}

TEST_CASE("an outlier is studentised by the mean and the scale of the others", "[estimator]") {
    // About their mean all records have the leverage 1 / n, and the figure has a form without leverages.
    Eigen::VectorXd y = normal_scores(20);
    y[7] = 6.0;
    const double n = 20.0;
    estimator::ResidualSample sample{y.array() - y.mean(), {}, 1.0, true};
    const auto result = estimator::diagnose(sample);
    const double others = (y.sum() - y[7]) / (n - 1.0);
    const double square = (y.array() - others).square().sum() - (y[7] - others) * (y[7] - others);
    const double t = (y[7] - others) / std::sqrt(square / (n - 2.0) * n / (n - 1.0));
    REQUIRE(result.outliers.size() == 1);
    CHECK(result.outliers.front().record == 7);
    CHECK_THAT(result.outliers.front().studentised, WithinRel(t, 1e-13));
    const boost::math::students_t_distribution<double> reference(n - 2.0);
    CHECK_THAT(result.outliers.front().p, WithinRel(2.0 * n * cdf(complement(reference, t)), 1e-11));
    CHECK(std::isnan(result.lag1));
    CHECK(std::isnan(result.ljung_box.p));
    CHECK(std::isnan(result.runs.p));
    // Against a known sd of 1 the residual itself counts.
    sample.scale_estimated = false;
    const auto known = estimator::diagnose(sample);
    REQUIRE_FALSE(known.outliers.empty());
    CHECK(known.outliers.front().record == 7);
    CHECK_THAT(known.outliers.front().studentised, WithinRel(sample.residual[7] / std::sqrt(1.0 - 1.0 / n), 1e-13));
    // Records that are fitted exactly whatever they read have nothing to be studentised.
    sample.fitted = n;
    CHECK(estimator::diagnose(sample).outliers.empty());
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
    CHECK_NOTHROW(estimator::diagnose(sample));
    auto wrong = sample;
    wrong.residual[3] = std::nan("");
    CHECK_THROWS_AS(estimator::diagnose(wrong), std::invalid_argument);
    wrong = sample;
    wrong.sequences = {4, 5};
    CHECK_THROWS_AS(estimator::diagnose(wrong), std::invalid_argument);
    wrong = sample;
    wrong.fitted = -1.0;
    CHECK_THROWS_AS(estimator::diagnose(wrong), std::invalid_argument);
}

}  // namespace orbid::tests::residual_diagnostic_test

#include "estimator/sampling/chain_diagnostic.hpp"

#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "estimator/interface/random_stream.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace orbid::tests::chain_diagnostic_test {

namespace {

struct Case {
    Eigen::MatrixXd draws;
    std::map<std::string, std::vector<double>> expected;
};

/// Chains and diagnostics of the R package posterior 1.4.0, made by tests/reference/chain_diagnostic.R.
std::map<std::string, Case> reference() {
    std::ifstream file(orbid::tests::source_folder() + "/tests/reference/chain_diagnostic.csv");
    REQUIRE(file);
    std::map<std::string, Case> cases;
    for (std::string line; std::getline(file, line);) {
        if (line.starts_with('#')) continue;
        std::istringstream fields(line);
        std::string name, item, number;
        std::getline(fields, name, ',');
        std::getline(fields, item, ',');
        std::vector<double> values;
        while (std::getline(fields, number, ','))
            values.push_back(std::stod(number));
        Case& one = cases[name];
        if (item != "chain") {
            one.expected[item] = values;
            continue;
        }
        const auto rows = static_cast<Eigen::Index>(values.size());
        one.draws.conservativeResize(rows, one.draws.cols() + 1);
        one.draws.rightCols(1) = Eigen::Map<Eigen::VectorXd>(values.data(), rows);
    }
    return cases;
}

Eigen::MatrixXd normal_chains(Eigen::Index rows, Eigen::Index chains, std::uint64_t seed, double correlation) {
    Eigen::MatrixXd draws(rows, chains);
    for (Eigen::Index c = 0; c < chains; ++c) {
        estimator::RandomStream stream(seed, estimator::RandomPurpose::posterior_sample, static_cast<std::uint64_t>(c));
        double x = stream.normal();
        for (Eigen::Index i = 0; i < rows; ++i) {
            draws(i, c) = x;
            x = correlation * x + std::sqrt(1.0 - correlation * correlation) * stream.normal();
        }
    }
    return draws;
}

}  // namespace

TEST_CASE("R-hat, effective sizes and standard errors agree with another program", "[estimator][reference]") {
    const auto cases = reference();
    REQUIRE(cases.size() == 10);
    constexpr std::array probabilities{0.025, 0.25, 0.5, 0.75, 0.975};
    for (const auto& [name, one] : cases) {
        CAPTURE(name);
        const Eigen::MatrixXd& x = one.draws;
        const auto& values = one.expected;
        const auto expected = [&values](const std::string& item, std::size_t i = 0) { return values.at(item).at(i); };
        // Rounding of sums of some hundred terms: worst measured between 3e-15 and 1e-14, the bound is ten times that.
        constexpr double rounding = 1e-13;
        CHECK_THAT(estimator::rank_normalised_rhat(x), WithinRel(expected("rhat"), rounding));
        CHECK_THAT(estimator::bulk_effective_sample_size(x), WithinRel(expected("ess_bulk"), rounding));
        CHECK_THAT(estimator::tail_effective_sample_size(x), WithinRel(expected("ess_tail"), rounding));
        CHECK_THAT(estimator::mean_effective_sample_size(x), WithinRel(expected("ess_mean"), rounding));
        CHECK_THAT(estimator::mean_standard_error(x), WithinRel(expected("mcse_mean"), rounding));
        CHECK_THAT(estimator::sd_standard_error(x), WithinRel(expected("mcse_sd"), rounding));
        for (std::size_t i = 0; i < probabilities.size(); ++i) {
            CAPTURE(probabilities[i]);
            CHECK_THAT(estimator::sample_quantile(x, probabilities[i]),
                       WithinRel(expected("quantiles", i), rounding) || WithinAbs(expected("quantiles", i), 1e-15));
            CHECK_THAT(estimator::quantile_effective_sample_size(x, probabilities[i]),
                       WithinRel(expected("ess_quantiles", i), rounding));
            CHECK_THAT(
                estimator::quantile_standard_error(x, probabilities[i]),
                WithinRel(expected("mcse_quantiles", i), rounding) || WithinAbs(expected("mcse_quantiles", i), 1e-15));
        }
    }
}

// The integrated autocorrelation time of a first-order autoregression is (1 + rho) / (1 - rho): 3 at rho = 0.5. Over 20
// seeds of 4 x 2000 draws the mean of the estimate is judged by its own scatter.
TEST_CASE("effective size of autoregressive chains", "[estimator]") {
    constexpr int seeds = 20;
    for (const double rho : {0.0, 0.5, 0.8}) {
        CAPTURE(rho);
        Eigen::VectorXd time(seeds);
        for (int s = 0; s < seeds; ++s)
            time[s] = 8000.0 /
                      estimator::mean_effective_sample_size(normal_chains(2000, 4, static_cast<std::uint64_t>(s), rho));
        const double mean = time.mean();
        const double error = std::sqrt((time.array() - mean).square().sum() / (seeds - 1) / seeds);
        const double exact = (1.0 + rho) / (1.0 - rho);
        CAPTURE(mean, error, exact);
        // Four standard errors, and 3 % for what Geyer's rule cuts off.
        CHECK(std::abs(mean - exact) < 4.0 * error + 0.03 * exact);
    }
}

TEST_CASE("monotone transformations leave the ranked diagnostics alone", "[estimator]") {
    const Eigen::MatrixXd x = normal_chains(300, 4, 7, 0.3);
    const Eigen::MatrixXd y = (3.0 * x.array()).exp();
    CHECK(estimator::bulk_effective_sample_size(x) == estimator::bulk_effective_sample_size(y));
    CHECK(estimator::quantile_effective_sample_size(x, 0.1) == estimator::quantile_effective_sample_size(y, 0.1));
    // Means and sds of all sizes: nothing depends on the unit.
    CHECK_THAT(estimator::mean_standard_error(1e-30 * x), WithinRel(1e-30 * estimator::mean_standard_error(x), 1e-12));
}

TEST_CASE("useless chains have no diagnostics", "[estimator]") {
    Eigen::MatrixXd nan = normal_chains(50, 2, 1, 0.0);
    nan(3, 1) = std::numeric_limits<double>::quiet_NaN();
    Eigen::MatrixXd infinite = normal_chains(50, 2, 1, 0.0);
    infinite(3, 1) = std::numeric_limits<double>::infinity();
    for (const Eigen::MatrixXd& x : {nan, infinite, Eigen::MatrixXd(Eigen::MatrixXd::Constant(50, 2, 0.1)),
                                     normal_chains(11, 4, 1, 0.0), Eigen::MatrixXd(0, 4), Eigen::MatrixXd(20, 0)}) {
        CAPTURE(x.rows(), x.cols());
        CHECK(std::isnan(estimator::rank_normalised_rhat(x)));
        CHECK(std::isnan(estimator::bulk_effective_sample_size(x)));
        CHECK(std::isnan(estimator::tail_effective_sample_size(x)));
        CHECK(std::isnan(estimator::mean_effective_sample_size(x)));
        CHECK(std::isnan(estimator::mean_standard_error(x)));
        CHECK(std::isnan(estimator::sd_standard_error(x)));
        CHECK(std::isnan(estimator::quantile_standard_error(x, 0.5)));
    }
    CHECK(std::isnan(estimator::sample_quantile(Eigen::MatrixXd(0, 4), 0.5)));
    CHECK(std::isfinite(estimator::rank_normalised_rhat(normal_chains(12, 4, 1, 0.0))));
}

}  // namespace orbid::tests::chain_diagnostic_test

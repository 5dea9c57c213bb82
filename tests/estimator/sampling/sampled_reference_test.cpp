// The sampler against published posteriors.

#include <cmath>
#include <string>
#include <vector>

#include "estimator/sampling/posterior_sample.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/estimate/reference_case.hpp"

namespace orbid::tests::sampled_reference_test {

namespace {

/// The tables come from 10^4 draws themselves: their error is that of as many independent ones.
constexpr double reference_draws = 1e4;

/// 5 joint standard errors, and half a unit of the last printed digit.
void check_mean(const estimator::SampledQuantity& quantity, const nlohmann::json& expected, double digit) {
    CAPTURE(quantity.name, quantity.mean, quantity.mean_error, quantity.sd, quantity.sd_error, expected.dump());
    const double sd = expected["sd"];
    CHECK(std::abs(quantity.mean - expected["mean"].get<double>()) <
          5.0 * std::hypot(quantity.mean_error, sd / std::sqrt(reference_draws)) + digit);
}

estimator::PosteriorSample sampled(const std::vector<estimator::FreeParameter>& parameters,
                                   estimator::Residual& residual, double acceptance) {
    const auto estimate = estimator::estimate(parameters, {&residual});
    CAPTURE(estimate.message);
    REQUIRE(estimate.status == estimator::EstimateStatus::converged);
    estimator::SampleOptions options;
    options.warm_up = 300;
    options.draws = 500;
    options.acceptance = acceptance;
    return estimator::sample_posterior(parameters, {&residual}, {}, {}, estimate, options);
}

}  // namespace

TEST_CASE("hare and lynx: the sampler meets the published posterior of all eight parameters",
          "[estimator][reference]") {
    auto residual = hare_lynx_residual();
    const auto sample = sampled(hare_lynx_parameters(), residual, 0.8);
    const auto reference = reference_json("hare_lynx/reference_posterior.json")["posterior"];
    CAPTURE(sample.message);
    CHECK(sample.trusted);
    for (const auto& quantity : sample.parameters) {
        check_mean(quantity, reference[quantity.name], 5e-7);
        const double sd = reference[quantity.name]["sd"];
        CHECK(std::abs(quantity.sd - sd) <
              5.0 * std::hypot(quantity.sd_error, sd / std::sqrt(2.0 * reference_draws)) + 5e-7);
    }
    REQUIRE(sample.errors.size() == 2);
    for (const auto& quantity : sample.errors)
        check_mean(quantity, reference[quantity.name.substr(0, quantity.name.find(':'))], 5e-7);
}

TEST_CASE("Michaelis and Menten: the sampler meets the published quantiles, heavy tail included",
          "[estimator][reference]") {
    auto residual = michaelis_menten_residual();
    // The tail of K_m is a ridge that is narrower than the rest of the posterior: with steps made for the rest chains
    // stay in or out of it for long, and the 97.5 % quantile comes out anywhere from 9 to 22; shorter ones enter it.
    const auto sample = sampled(michaelis_menten_parameters(), residual, 0.99);
    const auto reference = reference_json("michaelis_menten/reference_posterior.json")["posterior"];
    CAPTURE(sample.message);
    std::vector<estimator::SampledQuantity> all = sample.parameters;
    all.insert(all.end(), sample.errors.begin(), sample.errors.end());
    REQUIRE(all.size() == 4);
    for (const auto& quantity : all) {
        const auto expected = reference[quantity.name.substr(0, quantity.name.find(':'))];
        CAPTURE(quantity.name, quantity.quantiles[0], quantity.quantiles[2], quantity.quantiles[4], expected.dump(),
                quantity.tail_size);
        const auto check = [&](std::size_t at, const char* name) {
            const double value = expected[name];
            // Its standard error shrinks with the root of the draws.
            const double error = quantity.quantile_errors[at] * std::sqrt(1.0 + quantity.tail_size / reference_draws);
            CHECK(std::abs(quantity.quantiles[at] - value) < 5.0 * error + 5e-4 * value);
        };
        check(0, "q025");
        check(2, "median");
        check(4, "q975");
    }
}

}  // namespace orbid::tests::sampled_reference_test

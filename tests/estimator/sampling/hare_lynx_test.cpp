// Hudson's Bay hare and lynx: six dynamic parameters and two error scales against 10^4 reference draws
// (tests/reference/hare_lynx).

#include <cmath>

#include "estimator/exploration/marginal.hpp"
#include "estimator/sampling/posterior_sample.hpp"
#include "tests/estimator/estimate/reference_case.hpp"

namespace orbid::tests::hare_lynx_test {

namespace {

/// Names of the reference in the order of parameters and groups.
constexpr std::array names{"alpha", "beta", "gamma", "delta", "hare_0", "lynx_0", "sigma_hare", "sigma_lynx"};

}  // namespace

TEST_CASE("hare and lynx: nested Laplace and the sampler meet the reference posterior", "[estimator][reference]") {
    const nlohmann::json reference = reference_json("hare_lynx/reference_posterior.json")["posterior"];
    FlowResidual residual = hare_lynx_residual();
    const auto parameters = hare_lynx_parameters();
    estimator::EstimateOptions options;
    options.variance = estimator::Variance::integrated;
    const auto estimate = estimator::estimate(parameters, {&residual}, {}, options);
    CAPTURE(estimate.message);
    REQUIRE(estimate.status == estimator::EstimateStatus::converged);
    CAPTURE(estimate.distrust);
    CHECK(estimate.trust_normal);

    const auto nested = estimator::marginals(parameters, {&residual}, options, estimate);
    REQUIRE(nested.size() == names.size());
    for (std::size_t i = 0; i < names.size(); ++i) {
        const double mean = reference[names[i]]["mean"];
        const double sd = reference[names[i]]["sd"];
        CAPTURE(names[i], nested[i].name, nested[i].message);
        REQUIRE(nested[i].known);
        // Measured 0.016 sds and 1.7 %, of which 0.01 sds and 0.7 % are the error of 10^4 draws.
        CHECK_THAT((nested[i].mean - mean) / sd, WithinAbs(0.0, 0.05));
        CHECK_THAT(nested[i].sd / sd, WithinAbs(1.0, 0.02));
    }

    estimator::SampleOptions sampling;
    sampling.draws = 500;
    const auto sample = estimator::sample_posterior(parameters, {&residual}, {}, options, estimate, sampling);
    CAPTURE(sample.message, sample.distrust);
    REQUIRE(sample.status == estimator::SampleStatus::complete);
    for (std::size_t i = 0; i < names.size(); ++i) {
        const double mean = reference[names[i]]["mean"];
        const double sd = reference[names[i]]["sd"];
        const estimator::SampledQuantity& quantity = i < 6 ? sample.parameters[i] : sample.errors[i - 6];
        CAPTURE(names[i], quantity.name);
        // Four standard errors of both samples: 16 comparisons go wrong once in a thousand runs, and the seed is fixed.
        CHECK_THAT(quantity.mean, WithinAbs(mean, 4.0 * std::hypot(quantity.mean_error, 0.01 * sd)));
        CHECK_THAT(quantity.sd, WithinAbs(sd, 4.0 * std::hypot(quantity.sd_error, 0.007 * sd)));
        CHECK(quantity.rhat < 1.02);
    }
}

}  // namespace orbid::tests::hare_lynx_test

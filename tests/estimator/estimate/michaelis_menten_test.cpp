// One compartment with saturated elimination: the posterior of K_m has a heavy tail, and a normal approximation must
// not be trusted (tests/reference/michaelis_menten, 10^4 reference draws).

#include <cmath>

#include "estimator/exploration/marginal.hpp"
#include "estimator/sampling/posterior_sample.hpp"
#include "tests/estimator/estimate/reference_case.hpp"

namespace orbid::tests::michaelis_menten_test {

TEST_CASE("Michaelis-Menten: the heavy tail of K_m is noticed and its interval found", "[estimator][reference]") {
    const nlohmann::json reference = reference_json("michaelis_menten/reference_posterior.json")["posterior"];
    FlowResidual residual = michaelis_menten_residual();
    const auto parameters = michaelis_menten_parameters();
    estimator::EstimateOptions options;
    options.variance = estimator::Variance::integrated;
    const auto estimate = estimator::estimate(parameters, {&residual}, {}, options);
    CAPTURE(estimate.message);
    REQUIRE(estimate.status == estimator::EstimateStatus::converged);
    CHECK_FALSE(estimate.trust_normal);
    CHECK_THAT(estimate.distrust, ContainsSubstring("K_m"));

    // A quantile of the tail is a matter of its logarithm: within 25 %.
    const auto close = [&](const char* name, const char* quantile, double value) {
        CAPTURE(name, quantile, value);
        CHECK_THAT(std::log(value / reference[name][quantile].get<double>()), WithinAbs(0.0, std::log(1.25)));
    };
    const auto nested = estimator::marginals(parameters, {&residual}, options, estimate);
    REQUIRE(nested.size() == 4);
    const std::array names{"k_a", "K_m", "V_m", "sigma"};
    for (std::size_t i = 0; i < 4; ++i) {
        CAPTURE(nested[i].message);
        REQUIRE(nested[i].known);
        close(names[i], "q025", nested[i].lower95);
        close(names[i], "median", nested[i].median);
        close(names[i], "q975", nested[i].upper95);
    }

    estimator::SampleOptions sampling;
    sampling.acceptance = 0.95;  // the funnel towards K_m = 0 needs short steps
    const auto sample = estimator::sample_posterior(parameters, {&residual}, {}, options, estimate, sampling);
    CAPTURE(sample.message, sample.distrust);
    REQUIRE(sample.status == estimator::SampleStatus::complete);
    for (std::size_t i = 0; i < 4; ++i) {
        const estimator::SampledQuantity& quantity = i < 3 ? sample.parameters[i] : sample.errors[0];
        CAPTURE(quantity.name);
        CHECK(quantity.rhat < 1.02);
        // Four standard errors; the 10^4 reference draws add at most a tenth to them.
        const auto agrees = [&](const char* probability, std::size_t k) {
            CAPTURE(probability);
            CHECK_THAT(quantity.quantiles[k],
                       WithinAbs(reference[names[i]][probability].get<double>(), 4.4 * quantity.quantile_errors[k]));
        };
        agrees("q025", 0);
        agrees("median", 2);
        agrees("q975", 4);
    }
}

}  // namespace orbid::tests::michaelis_menten_test

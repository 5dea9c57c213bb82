// The same posterior whatever the coordinate in which steps, modes and densities are taken: priors are densities of the
// natural parameter, and their Jacobian comes with the coordinate.

#include <array>
#include <cmath>

#include "estimator/exploration/marginal.hpp"
#include "estimator/sampling/posterior_sample.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::scale_invariance_test {

namespace {

using estimator::Scale;

/// y = a exp(-b t) with few and coarse readings, so that the densities of a and b are lopsided and priors matter.
FunctionResidual decay() {
    constexpr std::array readings{1.31, 0.71, 0.62, 0.18, 0.27};
    FunctionResidual residual;
    residual.add_group(group("y", 0.15, false));
    residual.add_block(layout("decay", 5), [readings](const Eigen::VectorXd& theta, const Eigen::VectorXd&, bool) {
        estimator::BlockValue value;
        value.e.resize(5);
        value.e_theta.resize(5, 2);
        value.e_z.resize(5, 0);
        for (Eigen::Index i = 0; i < 5; ++i) {
            const double t = 0.5 + static_cast<double>(i);
            const double falling = std::exp(-theta[1] * t);
            value.e[i] = readings[static_cast<std::size_t>(i)] - theta[0] * falling;
            value.e_theta.row(i) << -falling, theta[0] * t * falling;
        }
        return value;
    });
    return residual;
}

std::vector<estimator::FreeParameter> parameters(Scale scale) {
    estimator::FreeParameter a = free_parameter("a", 1.0);
    a.prior = estimator::LogNormalPrior{1.2, 0.5};
    estimator::FreeParameter b = free_parameter("b", 0.5);
    b.prior = estimator::GammaPrior{2.0, 3.0};
    for (estimator::FreeParameter* parameter : {&a, &b}) {
        parameter->scale = scale;
        if (scale == Scale::linear) parameter->lower = 0.0;
        if (scale != Scale::logit) continue;
        // Ends that cut off less than 1e-9 of the posterior.
        parameter->lower = 0.0;
        parameter->upper = 12.0;
    }
    return {a, b};
}

}  // namespace

TEST_CASE("a posterior does not depend on the scale of its parameters", "[estimator]") {
    FunctionResidual residual = decay();
    // Means and sds of a and b by the trapezoidal rule on a fine grid of natural values.
    Eigen::Vector2d mean = Eigen::Vector2d::Zero();
    Eigen::Vector2d square = mean;
    double mass = 0.0;
    constexpr double step = 0.004;
    for (double a = step; a < 6.0; a += step)
        for (double b = step; b < 4.0; b += step) {
            const auto value =
                residual.evaluate(residual.initial_set(), Eigen::Vector2d(a, b), {Eigen::VectorXd()}, false).front();
            const double density = std::exp(-0.5 * value.e.squaredNorm() / (0.15 * 0.15) -
                                            estimator::negative_log_density(estimator::LogNormalPrior{1.2, 0.5}, a) -
                                            estimator::negative_log_density(estimator::GammaPrior{2.0, 3.0}, b));
            mass += density;
            mean += density * Eigen::Vector2d(a, b);
            square += density * Eigen::Vector2d(a * a, b * b);
        }
    mean /= mass;
    const Eigen::Vector2d sd = (square / mass - mean.cwiseAbs2()).cwiseSqrt();

    for (const Scale scale : {Scale::linear, Scale::log, Scale::log10, Scale::logit}) {
        CAPTURE(static_cast<int>(scale));
        const auto estimate = estimator::estimate(parameters(scale), {&residual});
        CAPTURE(estimate.message);
        REQUIRE(estimate.status == estimator::EstimateStatus::converged);
        const auto nested = estimator::marginals(parameters(scale), {&residual}, {}, estimate);
        estimator::SampleOptions sampling;
        sampling.draws = 2000;
        const auto sample = estimator::sample_posterior(parameters(scale), {&residual}, {}, {}, estimate, sampling);
        REQUIRE(sample.status == estimator::SampleStatus::complete);
        for (std::size_t i = 0; i < 2; ++i) {
            const auto k = static_cast<Eigen::Index>(i);
            CAPTURE(i, mean[k], sd[k]);
            // Five Monte-Carlo standard errors: one in two million for a right sampler, 16 numbers.
            CHECK_THAT(sample.parameters[i].mean, WithinAbs(mean[k], 5.0 * sample.parameters[i].mean_error));
            CHECK_THAT(sample.parameters[i].sd, WithinAbs(sd[k], 5.0 * sample.parameters[i].sd_error));
            // Laplace over the one other parameter is the only approximation.
            CHECK_THAT(nested[i].mean, WithinAbs(mean[k], 0.05 * sd[k]));
            CHECK_THAT(nested[i].sd, WithinRel(sd[k], 0.05));
        }
    }
}

}  // namespace orbid::tests::scale_invariance_test

#include "estimator/sampling/posterior_sample.hpp"

#include <oneapi/tbb/global_control.h>

#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <random>
#include <string>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>

#include "estimator/problem/problem.hpp"
#include "estimator/sampling/posterior_density.hpp"
#include "models/definition/wrong_data.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::posterior_sample_test {

namespace {

using estimator::Estimate;
using estimator::EstimateStatus;
using estimator::FreeParameter;
using estimator::PosteriorSample;
using estimator::SampleOptions;

/// A sound number is off by 5 Monte-Carlo standard errors once in 2e6 times; consecutive seeds, none chosen.
void check_within_error(double value, double truth, double error) {
    CAPTURE(value, truth, error);
    CHECK(std::abs(value - truth) < 5.0 * error);
}

SampleOptions options_of(std::uint64_t seed, int draws = 1000) {
    SampleOptions options;
    options.seed = seed;
    options.draws = draws;
    return options;
}

PosteriorSample sampled(const std::vector<FreeParameter>& parameters, estimator::Residual& residual,
                        const SampleOptions& options, const estimator::EstimateOptions& how = {},
                        const std::vector<estimator::DerivedQuantity>& derived = {}) {
    const Estimate estimate = estimator::estimate(parameters, {&residual}, derived, how);
    CAPTURE(estimate.message);
    return estimator::sample_posterior(parameters, {&residual}, derived, how, estimate, options);
}

struct Regression {
    Eigen::MatrixXd x;
    Eigen::VectorXd y;
};

Regression made_regression(Eigen::Index n) {
    std::mt19937_64 generator(3);
    std::normal_distribution<double> normal;
    Regression data{Eigen::MatrixXd(n, 2), Eigen::VectorXd(n)};
    for (Eigen::Index i = 0; i < n; ++i) {
        const double t = static_cast<double>(i) / static_cast<double>(n - 1);
        data.x.row(i) << 1.0, t;
        data.y[i] = 1.0 - 2.0 * t + 0.1 * normal(generator);
    }
    return data;
}

/// One parameter with one reading y of known sd 1.
std::unique_ptr<FunctionResidual> one_reading(double y) {
    auto residual = std::make_unique<FunctionResidual>();
    residual->add_group(group("y", 1.0, false));
    residual->add_block(layout("data", 1), linear(Eigen::VectorXd::Constant(1, y), Eigen::MatrixXd::Ones(1, 1)));
    return residual;
}

/// Everything at once: all laws, a covariance shape, known sds, latent states, bounds, every kind of prior.
struct Everything {
    FunctionResidual residual;
    std::vector<FreeParameter> parameters;
    estimator::EstimateOptions options;
};

std::unique_ptr<Everything> everything() {
    auto all = std::make_unique<Everything>();
    using namespace estimator;
    const auto add = [&](const char* name, ErrorDistribution distribution) {
        Group one = group(name, 0.4);
        one.distribution = distribution;
        all->residual.add_group(one);
    };
    add("normal", NormalErrors{});
    add("student", StudentErrors{{true, 4.0, GammaPrior{2.0, 0.1}}});
    add("laplace", LaplaceErrors{});
    add("lognormal", LogNormalErrors{});
    add("relative", RelativeErrors{{true, 0.1, HalfNormalPrior{0.2}}});
    add("autoregressive", AutoregressiveErrors{{true, 0.3, FlatPrior{}}});
    add("shaped", NormalErrors{});
    Group floored = group("floored", 0.3);
    floored.floor = 0.2;
    floored.scale.prior = LogNormalPrior{0.3, 0.5};
    all->residual.add_group(floored);

    std::mt19937_64 generator(5);
    std::normal_distribution<double> normal;
    const auto make = [&](const char* name, std::vector<int> groups, Eigen::Index latents, Eigen::MatrixXd shape = {}) {
        const auto n = static_cast<Eigen::Index>(groups.size());
        Eigen::MatrixXd x(n, 3);
        Eigen::MatrixXd z(n, latents);
        Eigen::VectorXd y(n);
        for (Eigen::Index i = 0; i < n; ++i) {
            for (Eigen::Index k = 0; k < 3; ++k)
                x(i, k) = normal(generator);
            for (Eigen::Index k = 0; k < latents; ++k)
                z(i, k) = normal(generator);
            y[i] = 6.0 + 0.3 * normal(generator);
        }
        BlockLayout block;
        block.label = name;
        block.group = std::move(groups);
        block.latents = latents;
        block.observed = y;
        block.shape = std::move(shape);
        if (block.label == "with deviations") block.deviation = Eigen::VectorXd::LinSpaced(n, 0.5, 2.0);
        // A prediction near 6 for all records, mildly nonlinear in theta and z.
        FunctionResidual::Function f = [x, z, y](const Eigen::VectorXd& theta, const Eigen::VectorXd& latent, bool) {
            BlockValue value;
            const Eigen::VectorXd angle =
                0.2 * (x * theta + (z.cols() > 0 ? Eigen::VectorXd(z * latent) : Eigen::VectorXd::Zero(y.size())));
            value.e = y - (6.0 + angle.array().sin()).matrix();
            const Eigen::VectorXd slope = -0.2 * angle.array().cos();
            value.e_theta = slope.asDiagonal() * x;
            value.e_z = slope.asDiagonal() * z;
            return value;
        };
        all->residual.add_block(block, f, Eigen::VectorXd::Constant(latents, 0.1));
    };
    make("mixed", {0, 1, 2, 3, 4, 5, 5, 5, 7, 0, 1, 2, 3, 4, 5, 7, 1}, 2);
    make("series", {5, 5, 5, 5, 0, 4, 3}, 1);
    make("with deviations", {0, 6, 1, 7}, 1);
    // Two records of one group and two of others under one covariance; known sds beside them.
    Eigen::MatrixXd correlated = Eigen::MatrixXd::Identity(4, 4);
    correlated(0, 1) = correlated(1, 0) = 0.5;
    correlated(2, 3) = correlated(3, 2) = -0.3;
    make("shaped", {0, 6, 6, 7}, 2, correlated);
    FreeParameter a = free_parameter("a", 0.7);
    a.scale = Scale::log;
    a.prior = NormalPrior{0.5, 0.4};
    a.lower = 0.0;
    FreeParameter b = free_parameter("b", 0.5);
    b.lower = 0.0;
    b.upper = 2.0;
    FreeParameter c = free_parameter("c", -0.4);
    c.upper = 1.0;
    c.prior = StudentPrior{3.0, 0.0, 1.0};
    all->parameters = {a, b, c};
    return all;
}

}  // namespace

// Flat prior in theta and ln s: theta is Student's t with n - q degrees of freedom about least squares, s^2 is
// inverse-gamma((n - q)/2, M/2).
TEST_CASE("linear regression with unknown scale has its closed form", "[estimator]") {
    constexpr Eigen::Index n = 14;
    constexpr double dof = 12.0;
    const Regression data = made_regression(n);
    const Eigen::MatrixXd inverse = (data.x.transpose() * data.x).inverse();
    const Eigen::VectorXd theta = inverse * data.x.transpose() * data.y;
    const double m = (data.y - data.x * theta).squaredNorm();
    const boost::math::students_t_distribution<double> t(dof);
    const boost::math::chi_squared_distribution<double> chi(dof);
    for (const std::uint64_t seed : {1, 2, 3}) {
        CAPTURE(seed);
        FunctionResidual residual;
        residual.add_group(group("y"));
        residual.add_block(layout("data", n), linear(data.y, data.x));
        const estimator::DerivedQuantity end{
            "end", [](const Eigen::VectorXd& x) { return x[0] + x[1]; },
            [](const Eigen::VectorXd& x) { return Eigen::VectorXd(Eigen::VectorXd::Ones(x.size())); }};
        const auto sample =
            sampled({free_parameter("a", 0.0), free_parameter("b", 0.0)}, residual, options_of(seed), {}, {end});
        CAPTURE(sample.message);
        REQUIRE(sample.status == estimator::SampleStatus::complete);
        CHECK(sample.trusted);
        CHECK(sample.distrust.empty());
        CHECK(sample.names == std::vector<std::string>{"a", "b", "end", "y:scale"});
        REQUIRE(sample.draws.size() == 4);
        CHECK(sample.draws[3].rows() == 1000);
        CHECK(sample.draws[3].cols() == 4);
        CHECK(sample.draws[2].col(2) == sample.draws[2].col(0) + sample.draws[2].col(1));
        const auto check_t = [&](const estimator::SampledQuantity& q, double centre, double variance) {
            CAPTURE(q.name);
            const double width = std::sqrt(m / dof * variance);
            check_within_error(q.mean, centre, q.mean_error);
            check_within_error(q.sd, width * std::sqrt(dof / (dof - 2.0)), q.sd_error);
            for (std::size_t p = 0; p < 5; ++p)
                check_within_error(q.quantiles[p], centre + width * quantile(t, estimator::sample_probabilities[p]),
                                   q.quantile_errors[p]);
        };
        check_t(sample.parameters[0], theta[0], inverse(0, 0));
        check_t(sample.parameters[1], theta[1], inverse(1, 1));
        check_t(sample.derived[0], theta.sum(), inverse.sum());
        const auto& s = sample.errors[0];
        check_within_error(s.mean, std::sqrt(0.5 * m) * std::tgamma(0.5 * (dof - 1.0)) / std::tgamma(0.5 * dof),
                           s.mean_error);
        for (std::size_t p = 0; p < 5; ++p)
            check_within_error(s.quantiles[p],
                               std::sqrt(m / quantile(complement(chi, estimator::sample_probabilities[p]))),
                               s.quantile_errors[p]);
    }
}

TEST_CASE("bounds truncate the posterior, also where the estimate is held at one", "[estimator]") {
    // N(y, 1) cut off: mean and variance of the truncated normal, and the 97.5 % quantile.
    const boost::math::normal_distribution<double> normal;
    constexpr double infinity = std::numeric_limits<double>::infinity();
    struct Case {
        double y, lower, upper, start;
    };
    std::uint64_t seed = 10;
    for (const Case& one :
         {Case{-0.5, 0.0, infinity, 1.0}, Case{0.5, 0.0, infinity, 1.0}, Case{2.0, -infinity, 1.0, 0.0},
          Case{-3.0, 0.0, 2.0, 1.0}, Case{0.3, 0.0, 1.0, 0.5}, Case{-30.0, 0.0, infinity, 1.0}}) {
        CAPTURE(one.y, one.lower, one.upper);
        const auto residual = one_reading(one.y);
        FreeParameter a = free_parameter("a", one.start);
        a.lower = one.lower;
        a.upper = one.upper;
        const auto sample = sampled({a}, *residual, options_of(++seed));
        CAPTURE(sample.message);
        CHECK(sample.worst_rhat < 1.01);
        const double below = std::isfinite(one.lower) ? cdf(normal, one.lower - one.y) : 0.0;
        const double above = std::isfinite(one.upper) ? cdf(complement(normal, one.upper - one.y)) : 0.0;
        const double at_lower = std::isfinite(one.lower) ? pdf(normal, one.lower - one.y) : 0.0;
        const double at_upper = std::isfinite(one.upper) ? pdf(normal, one.upper - one.y) : 0.0;
        const double mass = one.y < -5.0 ? cdf(complement(normal, one.lower - one.y)) : 1.0 - below - above;
        const double mean = one.y + (at_lower - at_upper) / mass;
        check_within_error(sample.parameters[0].mean, mean, sample.parameters[0].mean_error);
        if (one.y > -5.0)
            check_within_error(sample.parameters[0].quantiles[4], one.y + quantile(normal, below + 0.975 * mass),
                               sample.parameters[0].quantile_errors[4]);
        for (const Eigen::MatrixXd& draws : sample.draws) {
            CHECK(draws.minCoeff() >= one.lower);
            CHECK(draws.maxCoeff() <= one.upper);
        }
    }
}

TEST_CASE("with a proper prior the coordinate makes no difference", "[estimator]") {
    // y = 1 +- 1 with a gamma(2, 1) prior: p(a) = a exp(-a) exp(-(1 - a)^2 / 2) = a exp(-a^2 / 2) up to a constant,
    // which is Rayleigh's density: mean sqrt(pi / 2), sd sqrt(2 - pi / 2).
    std::uint64_t seed = 30;
    for (const auto scale : {estimator::Scale::linear, estimator::Scale::log, estimator::Scale::log10}) {
        CAPTURE(static_cast<int>(scale));
        const auto residual = one_reading(1.0);
        FreeParameter a = free_parameter("a", 1.0);
        a.prior = estimator::GammaPrior{2.0, 1.0};
        a.scale = scale;
        const auto sample = sampled({a}, *residual, options_of(++seed));
        CAPTURE(sample.message);
        // In logarithms this density falls like exp(-e^(2u)): now and then a trajectory diverges, and that is said.
        if (scale == estimator::Scale::linear) CHECK(sample.trusted);
        CHECK(sample.worst_rhat < 1.05);
        check_within_error(sample.parameters[0].mean, std::sqrt(std::numbers::pi / 2.0),
                           sample.parameters[0].mean_error);
        check_within_error(sample.parameters[0].sd, std::sqrt(2.0 - std::numbers::pi / 2.0),
                           sample.parameters[0].sd_error);
    }
}

// y = z + reading error, z = theta + matching error, theta with a joint normal prior: all normal, all closed.
TEST_CASE("latent states, a covariance shape and a joint prior of a linear problem", "[estimator]") {
    FunctionResidual residual;
    residual.add_group(group("reading", 0.5, false));
    residual.add_group(group("matching", 0.2, false));
    Eigen::MatrixXd precision = Eigen::MatrixXd::Zero(5, 5);  // of (a, b, z_1, z_2, z_3)
    Eigen::VectorXd right = Eigen::VectorXd::Zero(5);
    for (int k = 0; k < 3; ++k) {
        Eigen::MatrixXd x(2, 2);
        x << 0.0, 0.0, -1.0, -0.5 * k;
        Eigen::MatrixXd z = Eigen::MatrixXd::Ones(2, 1);
        const Eigen::VectorXd y = Eigen::Vector2d(1.0 + 0.7 * k, 0.0);
        estimator::BlockLayout block = layout("block " + std::to_string(k), 2);
        block.group = {0, 1};
        block.latents = 1;
        Eigen::Matrix2d shape = Eigen::Matrix2d::Identity();
        if (k == 1) {
            shape << 1.0, 0.4, 0.4, 2.0;
            block.shape = shape;
        }
        residual.add_block(block, linear(y, x, z), Eigen::VectorXd::Zero(1));
        const Eigen::Matrix2d sd = Eigen::Vector2d(0.5, 0.2).asDiagonal();
        const Eigen::Matrix2d weight = (sd * shape * sd).inverse();
        Eigen::MatrixXd design = Eigen::MatrixXd::Zero(2, 5);
        design.leftCols(2) = x;
        design.col(2 + k) = z;
        precision += design.transpose() * weight * design;
        right += design.transpose() * weight * y;
    }
    estimator::JointNormalPrior prior{{"a", "b"}, Eigen::Vector2d(0.5, 1.0), Eigen::MatrixXd(2, 2)};
    prior.covariance << 0.3, 0.1, 0.1, 0.4;
    precision.topLeftCorner(2, 2) += prior.covariance.inverse();
    right.head(2) += prior.covariance.inverse() * prior.mean;
    const Eigen::MatrixXd covariance = precision.inverse();
    const Eigen::VectorXd mean = covariance * right;

    estimator::EstimateOptions how;
    how.joint_priors = {prior};
    const auto sample = sampled({free_parameter("a", 0.0), free_parameter("b", 0.0)}, residual, options_of(41), how);
    CAPTURE(sample.message);
    CHECK(sample.trusted);
    for (Eigen::Index i = 0; i < 2; ++i) {
        const auto& parameter = sample.parameters[static_cast<std::size_t>(i)];
        check_within_error(parameter.mean, mean[i], parameter.mean_error);
        check_within_error(parameter.sd, std::sqrt(covariance(i, i)), parameter.sd_error);
    }
    REQUIRE(sample.latents[0].size() == 3);
    for (Eigen::Index k = 0; k < 3; ++k) {
        const double sd = std::sqrt(covariance(2 + k, 2 + k));
        // No standard errors of latent states are reported; of a well-mixed sample at least 1000 draws are effective.
        const auto at = static_cast<std::size_t>(k);
        check_within_error(sample.latents[0][at][0], mean[2 + k], sd / std::sqrt(1000.0));
        check_within_error(sample.latent_sds[0][at][0], sd, sd / std::sqrt(2000.0));
    }
}

TEST_CASE("the posterior density has the right gradient, for every law", "[estimator]") {
    const auto all = everything();
    const std::vector<estimator::ActiveSet> active{all->residual.initial_set()};
    const auto problem = estimator::set_up(all->parameters, {&all->residual}, active, {}, all->options);
    const auto set = estimator::freeze({&all->residual}, active, problem.channels, problem.laws);
    const auto state = estimator::initial_state(problem, active);
    const estimator::PosteriorDensity density(problem, set, {state.u, state.latents, state.psi});
    // 3 parameters, 6 latent states, 8 scales, dof, relative, correlation.
    REQUIRE(density.dimension() == 20);
    REQUIRE(density.covariance().rows() == 20);
    CHECK(density.covariance().llt().info() == Eigen::Success);
    std::mt19937_64 generator(9);
    std::normal_distribution<double> normal;
    for (int point = 0; point < 5; ++point) {
        Eigen::VectorXd x = density.start();
        for (double& one : x)
            one += 0.3 * normal(generator);
        Eigen::VectorXd gradient;
        REQUIRE(std::isfinite(density(x, &gradient)));
        for (Eigen::Index i = 0; i < x.size(); ++i) {
            CAPTURE(point, i);
            // Fourth-order differences; the step is small against the rounded cusp of Laplace's density, a hundredth
            // of its scale, and large enough for 1e-16 of the value over it.
            const auto at = [&](double h) {
                Eigen::VectorXd moved = x;
                moved[i] += h;
                return density(moved, nullptr);
            };
            const double h = 2e-4;
            const double slope = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
            CHECK_THAT(gradient[i], WithinRel(slope, 1e-7) || WithinAbs(slope, 1e-8));
        }
    }
}

TEST_CASE("the posterior density has the value of its formula", "[estimator]") {
    // One reading of unknown sd with a log-normal prior on s, a in [0, 2] with a normal prior.
    FunctionResidual residual;
    estimator::Group one = group("y", 0.5);
    one.scale.prior = estimator::LogNormalPrior{0.5, 0.3};
    residual.add_group(one);
    residual.add_block(layout("data", 1), linear(Eigen::VectorXd::Constant(1, 0.7), Eigen::MatrixXd::Ones(1, 1)));
    FreeParameter a = free_parameter("a", 1.0);
    a.lower = 0.0;
    a.upper = 2.0;
    a.prior = estimator::NormalPrior{0.8, 0.4};
    const std::vector<estimator::ActiveSet> active{residual.initial_set()};
    const auto problem = estimator::set_up({a}, {&residual}, active, {}, {});
    const auto set = estimator::freeze({&residual}, active, problem.channels, problem.laws);
    const auto state = estimator::initial_state(problem, active);
    const estimator::PosteriorDensity density(problem, set, {state.u, state.latents, state.psi});
    const Eigen::Vector2d x(0.3, std::log(0.6));
    const double value = 2.0 / (1.0 + std::exp(-0.3));
    const double ln_root = 0.5 * std::log(2.0 * std::numbers::pi);
    const double expected = ln_root + std::log(0.6) + 0.5 * std::pow((0.7 - value) / 0.6, 2) + ln_root + std::log(0.4) +
                            0.5 * std::pow((value - 0.8) / 0.4, 2) + ln_root + std::log(0.3) +
                            0.5 * std::pow(std::log(0.6 / 0.5) / 0.3, 2) - std::log(value * (2.0 - value) / 2.0);
    CHECK_THAT(density(x, nullptr), WithinRel(expected, 1e-13));
}

TEST_CASE("draws of a posterior do not depend on threads; progress and interruption", "[estimator][threads]") {
    const Regression data = made_regression(14);
    FunctionResidual residual;
    residual.add_group(group("y"));
    residual.add_block(layout("data", 14), linear(data.y, data.x));
    const std::vector<FreeParameter> parameters{free_parameter("a", 0.0), free_parameter("b", 0.0)};
    SampleOptions options = options_of(1, 40);
    options.warm_up = 50;
    const auto run = [&](std::size_t threads) {
        const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism, threads);
        return sampled(parameters, residual, options);
    };
    const auto one = run(1);
    for (const std::size_t threads : {2, 4}) {
        const auto many = run(threads);
        for (std::size_t c = 0; c < 4; ++c)
            CHECK(many.draws[c] == one.draws[c]);
        CHECK(many.parameters[0].rhat == one.parameters[0].rhat);
    }
    // 160 draws cannot be worth 400.
    CHECK_FALSE(one.trusted);
    CHECK_THAT(one.distrust, ContainsSubstring("effective sample size"));

    int done = 0;
    options.progress = [&](int made, int total) {
        done = made;
        CHECK(total == 360);
    };
    options.interrupted = [&] { return done >= 300; };
    const auto part = run(4);
    CHECK(part.status == estimator::SampleStatus::interrupted);
    CHECK_FALSE(part.trusted);
    for (const Eigen::MatrixXd& draws : part.draws)
        CHECK(draws.rows() == part.draws[0].rows());
    CHECK(part.draws[0] == one.draws[0].topRows(part.draws[0].rows()));
    options.interrupted = [] { return true; };
    const auto none = run(2);
    CHECK(none.status == estimator::SampleStatus::interrupted);
    CHECK(none.draws[0].rows() == 0);
    CHECK_FALSE(none.trusted);
}

TEST_CASE("improper posteriors and wrong calls are refused by name", "[estimator]") {
    const auto refused = [](const std::vector<FreeParameter>& parameters, estimator::Residual& residual,
                            const std::string& word) {
        const Estimate estimate = estimator::estimate(parameters, {&residual});
        CAPTURE(estimate.message);
        CHECK_THROWS_AS(estimator::sample_posterior(parameters, {&residual}, {}, {}, estimate, options_of(1, 20)),
                        models::DataError);
        CHECK_THROWS_WITH(estimator::sample_posterior(parameters, {&residual}, {}, {}, estimate, options_of(1, 20)),
                          ContainsSubstring(word));
    };
    const Regression data = made_regression(14);
    const auto regression = [&](const Eigen::MatrixXd& x) {
        auto residual = std::make_unique<FunctionResidual>();
        residual->add_group(group("y"));
        residual->add_block(layout("data", 14), linear(data.y, x));
        return residual;
    };
    SECTION("a direction that nothing decides, unless a prior or two bounds close it") {
        Eigen::MatrixXd same(14, 2);
        same << data.x.col(1), data.x.col(1);
        const auto residual = regression(same);
        std::vector<FreeParameter> parameters{free_parameter("first", 1.0), free_parameter("second", 1.0)};
        refused(parameters, *residual, "first and second enter only in a combination");
        parameters[0].lower = -10.0;
        parameters[0].upper = 10.0;
        SampleOptions options = options_of(1, 100);
        options.warm_up = 150;
        CHECK(sampled(parameters, *residual, options).status == estimator::SampleStatus::complete);
        parameters[0] = free_parameter("first", 1.0);
        parameters[1].prior = estimator::NormalPrior{0.0, 1.0};
        CHECK(sampled(parameters, *residual, options).status == estimator::SampleStatus::complete);
    }
    SECTION("scales that may vanish") {
        FunctionResidual residual;
        residual.add_group(group("reading", 0.3));
        residual.add_group(group("matching", 0.3, false));
        for (int k = 0; k < 6; ++k) {
            estimator::BlockLayout block = layout("block", 2);
            block.group = {0, 1};
            block.latents = 1;
            Eigen::MatrixXd x(2, 1);
            x << 0.0, -1.0;
            residual.add_block(block, linear(Eigen::Vector2d(0.3 * k, 0.0), x, Eigen::MatrixXd::Ones(2, 1)),
                               Eigen::VectorXd::Zero(1));
        }
        refused({free_parameter("a", 0.0)}, residual, "\"reading\"");
    }
    SECTION("equality constraints, records that say nothing about a latent state, a scale without records") {
        const auto with_latent = [&](Eigen::Index constraints, const Eigen::MatrixXd& z) {
            auto residual = std::make_unique<FunctionResidual>();
            residual->add_group(group("y", 0.1, false));
            estimator::BlockLayout block = layout("held", 14);
            block.latents = 1;
            block.constraints = constraints;
            residual->add_block(block, linear(data.y, data.x, z), Eigen::VectorXd::Zero(1));
            return residual;
        };
        const std::vector<FreeParameter> parameters{free_parameter("a", 0.0), free_parameter("b", 0.0)};
        const auto good = with_latent(0, data.x.col(1).cwiseAbs2());
        const Estimate estimate = estimator::estimate(parameters, {good.get()});
        REQUIRE(estimate.status == EstimateStatus::converged);
        const auto held = with_latent(1, data.x.col(1).cwiseAbs2());
        Estimate of_held = estimate;
        of_held.active = {held->initial_set()};
        CHECK_THROWS_WITH(estimator::sample_posterior(parameters, {held.get()}, {}, {}, of_held),
                          ContainsSubstring("\"held\" has equality constraints") && ContainsSubstring("small sd"));
        const auto blind = with_latent(0, Eigen::MatrixXd::Zero(14, 1));
        CHECK_THROWS_WITH(estimator::sample_posterior(parameters, {blind.get()}, {}, {}, estimate),
                          ContainsSubstring("\"held\" do not determine its latent states"));

        const auto residual = regression(data.x);
        residual->add_group(group("idle", 0.5));
        refused(parameters, *residual, "\"idle\"");
    }
    SECTION("not converged") {
        const auto residual = regression(data.x);
        const std::vector<FreeParameter> parameters{free_parameter("a", 0.0), free_parameter("b", 0.0)};
        Estimate estimate = estimator::estimate(parameters, {residual.get()});
        estimate.status = EstimateStatus::no_progress;
        CHECK_THROWS_WITH(estimator::sample_posterior(parameters, {residual.get()}, {}, {}, estimate),
                          ContainsSubstring("status is no_progress"));
        CHECK_THROWS_AS(estimator::sample_posterior(parameters, {residual.get()}, {}, {}, estimate), models::DataError);
        estimate.status = EstimateStatus::converged;
        CHECK_THROWS_AS(estimator::sample_posterior({free_parameter("a", 0.0)}, {residual.get()}, {}, {}, estimate),
                        std::invalid_argument);
        CHECK_THROWS_WITH(estimator::sample_posterior({free_parameter("a", 0.0)}, {residual.get()}, {}, {}, estimate),
                          ContainsSubstring("does not belong"));
        SampleOptions none;
        none.draws = 0;
        CHECK_THROWS_WITH(estimator::sample_posterior(parameters, {residual.get()}, {}, {}, estimate, none),
                          ContainsSubstring("draws = 0"));
    }
}

}  // namespace orbid::tests::posterior_sample_test

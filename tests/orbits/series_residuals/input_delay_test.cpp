// The delay of a measured input, estimated with the parameters of the model that it drives.

#include <array>
#include <cmath>

#include "models/equations/equation_text.hpp"
#include "orbits/series_residuals/series_residual.hpp"
#include "orbits/simulation/transition.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/series_residuals/shooting_case.hpp"

namespace input_delay_test {

using namespace orbid;
using namespace orbid::orbits;
using tests::base_theta;
using tests::bound;
using tests::ContainsSubstring;
using tests::derivative_error;
using tests::WithinAbs;
using Interpolation = models::InputSignal::Interpolation;

namespace {

/// A driven oscillator; `lag` is the delay of its input and stands in no equation. As a text, because a model of this
/// file would be compiled without optimisation.
std::shared_ptr<const models::System> shaken() {
    models::EquationText text;
    text.coordinates = {{"x", "v"}, {"v", "u - k * x - c * v - 5 * x^3"}};
    text.parameters = {{"k", "1/s^2", models::positive, 30.0},
                       {"c", "1/s", models::positive, 0.8},
                       {"lag", "s", models::any_real, 0.013}};
    text.inputs = {{"u", "", "m/s^2"}};
    text.used_outside = {"lag"};
    std::vector<models::EquationProblem> problems;
    return models::system_from_text(text, problems);
}

constexpr double true_lag = 0.013;
const std::vector<std::string> names{"k", "c", "lag"};

/// What the recorder has of u, from -0.5 s on every 0.02 s; `later`: with instants that are so much later.
std::shared_ptr<const models::InputSignal> record(Interpolation interpolation, double later) {
    std::vector<double> times, values;
    for (int k = 0; k <= 600; ++k) {
        const double t = -0.5 + 0.02 * k;
        times.push_back(t + later);
        values.push_back(6.0 * std::sin(4.1 * t) + 5.0 * std::cos(7.3 * t + 0.4) + 3.0 * std::sin(13.0 * t));
    }
    return std::make_shared<models::InputSignal>(times, values, 1, interpolation);
}

/// 11 s, read every 0.02 s but not at the instants of the input.
Series readings(Interpolation interpolation, double noise, std::uint64_t seed) {
    const auto system = shaken()->with_input(record(interpolation, true_lag));
    VirtualExperimentOptions options;
    options.plan = SamplePlan{0.02, 501, 0};
    options.phase = 0.007;
    options.initial = Eigen::Vector2d(0.2, -0.5);
    options.noise = Eigen::Vector2d(noise, 0.0);
    options.seed = seed;
    Series series = simulate(*system, system->default_parameters(), options).series;
    series.coordinates.resize(1);
    series.segments[0].values = series.segments[0].values.topRows(1).eval();
    return series;
}

template <class Options>
Options options_with(Interpolation interpolation, const Eigen::VectorXd& start) {
    Options options;
    options.inputs = {record(interpolation, 0.0)};
    options.start = start;
    options.delay = InputDelay{2, 0.0, 0.04};
    return options;
}

std::vector<estimator::FreeParameter> parameters(const Eigen::VectorXd& start) {
    std::vector<estimator::FreeParameter> result;
    for (std::size_t i = 0; i < names.size(); ++i) {
        estimator::FreeParameter p;
        p.name = names[i];
        p.start = start[static_cast<Eigen::Index>(i)];
        p.lower = 0.0;
        p.upper = names[i] == "lag" ? 0.04 : 100.0;
        p.typical_size = names[i] == "lag" ? 0.01 : p.start;
        result.push_back(p);
    }
    return result;
}

estimator::Estimate estimated(const Eigen::VectorXd& start, const estimator::Residual& residual) {
    estimator::EstimateOptions options;
    options.verdict = false;
    options.clusters = estimator::Clusters::none;
    return estimator::estimate(parameters(start), {&residual}, {}, options);
}

const Eigen::Vector3d far_start(25.0, 1.2, 0.004);

}  // namespace

TEST_CASE("a delay of the input has exact derivatives", "[orbits][delay]") {
    const auto system = shaken();
    const auto binding = bound(*system, system->default_parameters(), names);
    const Eigen::VectorXd theta = base_theta(binding);
    for (const auto interpolation : {Interpolation::linear, Interpolation::cubic, Interpolation::band_limited}) {
        CAPTURE(models::name(interpolation));
        const Series series = readings(interpolation, 1e-3, 1);
        const SeriesResidual whole(system, binding, series, options_with<SeriesResidualOptions>(interpolation, theta));
        const auto set = whole.initial_set();
        const auto latents = whole.initial_latents();
        const auto value = whole.evaluate(set, theta, latents, true).front();
        Eigen::VectorXd above = theta, below = theta;
        constexpr double h = 1e-5;
        above[2] += h;
        below[2] -= h;
        const Eigen::VectorXd difference = (whole.evaluate(set, above, latents, false).front().e -
                                            whole.evaluate(set, below, latents, false).front().e) /
                                           (2.0 * h);
        // Corners of a linear input make an error of order h: measured 1e-5 of a slope of 3.
        CHECK((value.e_theta.col(2) - difference).cwiseAbs().maxCoeff() < 1e-4 * difference.cwiseAbs().maxCoeff());
        CHECK(difference.cwiseAbs().maxCoeff() > 0.5);

        auto options = options_with<ShootingOptions>(interpolation, theta);
        options.interval = 20;
        const ShootingResidual nodes(system, binding, series, options);
        CHECK(derivative_error(nodes, theta, nodes.initial_latents()) < 1e-3);
    }
}

TEST_CASE("transitions are predicted with the delay of the input and its derivative", "[orbits][delay]") {
    const auto system = shaken();
    const std::vector<std::shared_ptr<const models::System>> systems{
        system->with_input(record(Interpolation::cubic, 0.0))};
    const std::vector<Transition> list{{Eigen::Vector2d(0.2, -0.5), Eigen::Vector2d(0.1, 0.3), 1.0, 0.4, 0}};
    const std::vector<Eigen::Index> free{2, 0};
    const auto at = [&](double lag) {
        Eigen::VectorXd theta = system->default_parameters();
        theta[2] = lag;
        return predictions(systems, theta, list, free, models::Clock::time, {1e-12, 1e-12, 20000}, 2).front();
    };
    const Eigen::VectorXd difference = (at(true_lag + 1e-5).error - at(true_lag - 1e-5).error) / 2e-5;
    // The error is to - Phi.
    CHECK((at(true_lag).by_free.col(0) + difference).norm() < 1e-6);
    CHECK(difference.norm() > 0.1);
}

TEST_CASE("a delay of the input is found, and covered by its interval", "[orbits][delay]") {
    const auto system = shaken();
    const auto binding = bound(*system, system->default_parameters(), names);
    const Eigen::VectorXd truth = base_theta(binding);
    for (const auto interpolation : {Interpolation::linear, Interpolation::cubic, Interpolation::band_limited}) {
        CAPTURE(models::name(interpolation));
        double squares = 0.0;
        constexpr std::uint64_t seeds = 8;
        for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
            const Series series = readings(interpolation, 3e-3, seed);
            const SeriesResidual whole(system, binding, series,
                                       options_with<SeriesResidualOptions>(interpolation, far_start));
            const auto estimate = estimated(far_start, whole);
            CHECK(estimate.status == estimator::EstimateStatus::converged);
            for (std::size_t j = 0; j < names.size(); ++j) {
                CAPTURE(seed, names[j], estimate.parameters[j].value, estimate.parameters[j].sd);
                const double z =
                    (estimate.parameters[j].value - truth[static_cast<Eigen::Index>(j)]) / estimate.parameters[j].sd;
                CHECK(std::abs(z) < 4.0);
                squares += z * z;
            }
            CHECK(estimate.parameters[2].sd < 5e-4);
        }
        // 24 squares of about unit variance: mean within four sds, sqrt(2 / 24) each.
        CHECK_THAT(squares / (3.0 * seeds), WithinAbs(1.0, 4.0 * std::sqrt(2.0 / 24.0)));
    }
    const Series series = readings(Interpolation::cubic, 3e-3, 1);
    auto options = options_with<ShootingOptions>(Interpolation::cubic, far_start);
    options.interval = 25;
    const auto by_nodes = estimated(far_start, ShootingResidual(system, binding, series, options));
    CHECK(by_nodes.status == estimator::EstimateStatus::converged);
    CHECK(std::abs(by_nodes.parameters[2].value - true_lag) < 4.0 * by_nodes.parameters[2].sd);
}

TEST_CASE("delays that the record of the input cannot tell are refused", "[orbits][delay]") {
    const auto system = shaken();
    const auto binding = bound(*system, system->default_parameters(), names);
    const Eigen::VectorXd theta = base_theta(binding);
    const Series series = readings(Interpolation::linear, 1e-3, 1);
    const auto made = [&](const SeriesResidualOptions& options) {
        return SeriesResidual(system, binding, series, options);
    };
    auto options = options_with<SeriesResidualOptions>(Interpolation::held, theta);
    CHECK_THROWS_WITH(made(options), ContainsSubstring("an input that jumps has no derivative"));
    // Held fixed, a delay of a held input is a number like others.
    const auto held = bound(*system, system->default_parameters(), {"k", "c"});
    options.start = Eigen::Vector2d(30.0, 0.8);
    CHECK_NOTHROW(SeriesResidual(system, held, series, options));
    options = options_with<SeriesResidualOptions>(Interpolation::cubic, theta);
    options.delay = InputDelay{2, 0.0, 0.6};
    CHECK_THROWS_WITH(made(options), ContainsSubstring("with delays in [0, 0.6] s"));
    options.delay = InputDelay{2, 0.0, std::numeric_limits<double>::infinity()};
    CHECK_THROWS_WITH(made(options), ContainsSubstring("needs bounds on both sides"));
    options.delay = InputDelay{2, 0.0, 0.04};
    options.sensor.type = models::Sensor::Type::function;
    options.sensor.functions.push_back(
        {0, models::Expression::parse(
                "x + u", models::reading_names(system->coordinates(), system->parameters(), system->inputs()))});
    CHECK_THROWS_WITH(made(options), ContainsSubstring("where a formula of the sensor reads an input"));
}

}  // namespace input_delay_test

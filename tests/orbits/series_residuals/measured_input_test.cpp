// Series of a model that reads a measured input: simulated, fitted and predicted segment by segment.

#include <cmath>
#include <memory>

#include "models/kernels/model_system.hpp"
#include "orbits/series_residuals/series_residual.hpp"
#include "orbits/series_residuals/shooting_residual.hpp"
#include "orbits/simulation/node_state.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/catch.hpp"

namespace measured_input_test {

using namespace orbid;
using namespace orbid::orbits;
using tests::ContainsSubstring;
using tests::WithinAbs;

namespace {

/// x' = u(t) - k x. With u = a + b t the solution is known: x = (a - b / k) / k + b t / k + C exp(-k t).
struct Lag {
    static constexpr std::string_view name = "lag", summary = "", equations = "";
    static constexpr std::array coordinates{models::real("x", "V")};
    static constexpr std::array parameters{models::Parameter{"k", "1/s", models::positive, 0.8, "rate"}};
    static constexpr std::array inputs{models::real("u", "V/s")};

    template <class T>
    static models::State<T, 1> rhs(const T& /*t*/, const models::State<T, 1>& x, const models::Values<T, 1>& p,
                                   const std::array<T, 1>& u) {
        return {u[0] - p[0] * x[0]};
    }
};

/// A hat: u rises from 1 to 3 in [from, from + 2], and falls back in the next 3 s.
std::shared_ptr<const models::InputSignal> hat(double from) {
    const std::vector<double> times{from, from + 2.0, from + 5.0};
    const std::vector<double> values{1.0, 3.0, 1.0};
    return std::make_shared<models::InputSignal>(times, values, 1, models::InputSignal::Interpolation::linear);
}

double ramp(double x0, double a, double b, double k, double t) {
    const auto settled = [&](double s) { return (a - b / k) / k + b * s / k; };
    return settled(t) + (x0 - settled(0.0)) * std::exp(-k * t);
}

/// x at `t` after the start of the hat.
double exact(double x0, double k, double t) {
    if (t <= 2.0) return ramp(x0, 1.0, 1.0, k, t);
    return ramp(ramp(x0, 1.0, 1.0, k, 2.0), 3.0, -2.0 / 3.0, k, t - 2.0);
}

std::shared_ptr<const models::System> lag() {
    return std::make_shared<models::ModelSystem<Lag>>();
}

models::ParameterBinding binding() {
    return {Eigen::VectorXd::Constant(1, 0.8), {0}, {0}, 1};
}

/// Two segments with clocks of their own, each over its own hat.
Series record() {
    Series series;
    series.sampling = Series::Sampling::samples;
    series.coordinates = {{"x", "V", false}};
    const double begin[] = {100.0, -3.0};
    const double start[] = {0.5, 2.0};
    for (int s = 0; s < 2; ++s) {
        Segment segment{std::to_string(s), Eigen::MatrixXd(1, 41), Eigen::VectorXd(41), {}};
        for (Eigen::Index k = 0; k < 41; ++k) {
            const double t = 0.125 * static_cast<double>(k);
            segment.times[k] = begin[s] + t;
            segment.values(0, k) = exact(start[s], 0.8, t);
        }
        series.segments.push_back(segment);
    }
    return series;
}

}  // namespace

TEST_CASE("the phase of a model with measured inputs is the time on their clock", "[orbits]") {
    const auto system = lag();
    CHECK(phase_rate(*system, system->default_parameters()) == 1.0);
}

TEST_CASE("an experiment follows its measured input from chunk to chunk", "[orbits]") {
    const auto system = lag()->with_input(hat(0.0));
    VirtualExperimentOptions options;
    // 5000 samples: the flow is called twice, the second time far from the start of the signal.
    options.plan = SamplePlan{0.001, 5001, 0};
    options.initial = Eigen::MatrixXd::Constant(1, 1, 0.5);
    const auto run = simulate(*system, system->default_parameters(), options);
    REQUIRE(run.complete);
    double worst = 0.0;
    for (Eigen::Index k = 0; k < 5001; ++k)
        worst = std::max(
            worst, std::abs(run.series.segments[0].values(0, k) - exact(0.5, 0.8, 0.001 * static_cast<double>(k))));
    CHECK(worst < 1e-10);  // tolerance 1e-12 per step

    options.plan = SamplePlan{0.001, 5003, 0};
    const auto longer = simulate(*system, system->default_parameters(), options);
    CHECK_FALSE(longer.complete);
    CHECK_THAT(longer.message, ContainsSubstring("measured input does not reach that far"));
}

TEST_CASE("segments are predicted on the clocks of their own inputs", "[orbits]") {
    SeriesResidualOptions options;
    options.inputs = {hat(100.0), hat(-3.0)};
    const SeriesResidual residual(lag(), binding(), record(), options);
    const Eigen::VectorXd theta = Eigen::VectorXd::Constant(1, 0.8);
    const std::vector<Eigen::VectorXd> z{Eigen::VectorXd::Constant(1, 0.5), Eigen::VectorXd::Constant(1, 2.0)};
    const auto values = residual.evaluate(residual.initial_set(), theta, z, true);
    for (const auto& value : values) {
        REQUIRE(value.status == estimator::BlockStatus::ok);
        CHECK(value.e.cwiseAbs().maxCoeff() < 1e-10);
    }
    // d x / d x0 = exp(-k t), d x / d k from differences of the closed form.
    for (Eigen::Index r = 0; r < 41; ++r) {
        const double t = 0.125 * static_cast<double>(r), h = 1e-4;
        CHECK_THAT(values[1].e_z(r, 0), WithinAbs(-std::exp(-0.8 * t), 1e-10));
        const double slope = (exact(2.0, 0.8 + h, t) - exact(2.0, 0.8 - h, t)) / (2.0 * h);
        CHECK_THAT(values[1].e_theta(r, 0), WithinAbs(-slope, 1e-6));
    }
    CHECK_THAT(residual.initial_latents()[1][0], WithinAbs(2.0, 1e-12));
    const auto predictions = residual.predict(theta, Eigen::VectorXd::Ones(1), {1});
    REQUIRE(predictions.size() == 1);
    CHECK(predictions[0].rms[0] < 1e-9);
}

TEST_CASE("inputs that do not fit a series are refused", "[orbits]") {
    const auto refused = [](std::vector<std::shared_ptr<const models::InputSignal>> inputs, const std::string& rule) {
        SeriesResidualOptions options;
        options.inputs = std::move(inputs);
        CAPTURE(rule);
        CHECK_THROWS_WITH(SeriesResidual(lag(), binding(), record(), options), ContainsSubstring(rule));
    };
    refused({}, "model lag reads measured inputs: 0 signals for 2 segments");
    refused({hat(100.0)}, "1 signals for 2 segments");
    refused({hat(100.0), hat(-2.5)}, "segment 1: the measured inputs cover [-2.5, 2.5] s, not the [-3, 2] s");
    refused({hat(99.0), hat(-3.0)}, "segment 0: the measured inputs cover [99, 104] s, not the [100, 105] s");
}

TEST_CASE("nodes of several intervals meet exactly under measured inputs", "[orbits][shooting]") {
    const Series series = record();
    ShootingOptions options;
    options.interval = 7;
    options.inputs = {hat(100.0), hat(-3.0)};
    options.flow = {1e-10, 1e-10, 100000};
    options.matching.kind = Continuity::Kind::normal;
    options.matching.sd = Eigen::VectorXd::Constant(1, 1e-8);
    const ShootingResidual residual(lag(), binding(), series, options);
    REQUIRE(residual.layout().size() == 12);
    const auto nodes = residual.initial_latents();
    const Eigen::VectorXd theta = Eigen::VectorXd::Constant(1, 0.8);
    const auto values = residual.evaluate(residual.initial_set(), theta, nodes, true);
    const Eigen::VectorXd above = theta.array() + 1e-5;
    const Eigen::VectorXd below = theta.array() - 1e-5;
    const auto high = residual.evaluate(residual.initial_set(), above, nodes, false);
    const auto low = residual.evaluate(residual.initial_set(), below, nodes, false);
    for (std::size_t b = 0; b < values.size(); ++b) {
        REQUIRE(values[b].status == estimator::BlockStatus::ok);
        // The solution is known; kinks of the input lie at samples. Tolerance 1e-10 over some ten steps.
        CHECK(values[b].e.cwiseAbs().maxCoeff() < 1e-8);
        const Eigen::VectorXd slope = (high[b].e - low[b].e) / 2e-5;
        CHECK((slope - values[b].e_theta.col(0)).cwiseAbs().maxCoeff() < 1e-4);
    }
    options.inputs.pop_back();
    CHECK_THROWS_WITH(ShootingResidual(lag(), binding(), series, options), ContainsSubstring("1 signals for 2"));
}

}  // namespace measured_input_test

#include <cmath>
#include <numbers>

#include "estimator/interface/random_stream.hpp"
#include "orbits/cycle_residuals/one_period_residual.hpp"
#include "orbits/series_residuals/continuity_report.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/series_residuals/shooting_case.hpp"

namespace shooting_estimation_test {

using namespace orbid;
using namespace orbid::orbits;
using tests::base_theta;
using tests::bound;
using tests::encoder;
using tests::PendulumCase;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

constexpr double encoder_step = 2.0 * std::numbers::pi / 4096.0;

std::vector<estimator::FreeParameter> parameters(const std::vector<std::string>& names, const Eigen::VectorXd& start) {
    std::vector<estimator::FreeParameter> result;
    for (std::size_t i = 0; i < names.size(); ++i) {
        estimator::FreeParameter p;
        p.name = names[i];
        p.start = start[static_cast<Eigen::Index>(i)];
        p.lower = 0.0;
        p.typical_size = std::abs(p.start);
        result.push_back(p);
    }
    return result;
}

Eigen::VectorXd values(const estimator::Estimate& estimate) {
    Eigen::VectorXd theta(std::ssize(estimate.parameters));
    for (std::size_t i = 0; i < estimate.parameters.size(); ++i)
        theta[static_cast<Eigen::Index>(i)] = estimate.parameters[i].value;
    return theta;
}

Eigen::VectorXd sds(const estimator::Estimate& estimate) {
    Eigen::VectorXd sd(std::ssize(estimate.parameters));
    for (std::size_t i = 0; i < estimate.parameters.size(); ++i)
        sd[static_cast<Eigen::Index>(i)] = estimate.parameters[i].sd;
    return sd;
}

/// Nothing but the estimate and Laplace's sds.
estimator::EstimateOptions plain() {
    estimator::EstimateOptions options;
    options.verdict = false;
    options.clusters = estimator::Clusters::none;
    options.step_tolerance = 1e-3;
    return options;
}

estimator::Estimate predicted(std::shared_ptr<const models::System> system, const models::ParameterBinding& binding,
                              const Series& series, const models::Sensor& sensor, const std::vector<std::string>& names,
                              const Eigen::VectorXd& start) {
    const auto made = transitions(*system, binding.values(start), series, sensor, {}, 1, 1000, 0);
    PredictionOptions options;
    options.sizes = error_sizes(sensor, coordinate_range(*system, series, {}));
    PredictionResidual residual({system}, binding, made, transition_clock(*system, series), start, options);
    return estimator::estimate(parameters(names, start), {&residual}, {}, plain());
}

const std::vector<std::string> pendulum_names{"l", "k1", "k2", "k3"};

}  // namespace

TEST_CASE("prediction over one interval finds the parameters of clean data", "[orbits][shooting]") {
    const PendulumCase c(300, {});
    const auto binding = bound(*c.system, c.base, pendulum_names);
    const Eigen::VectorXd truth = base_theta(binding);
    const Eigen::VectorXd start = truth.cwiseProduct(Eigen::Vector4d(1.4, 0.2, 3.0, 0.5));
    const auto estimate = predicted(c.system, binding, c.series, c.sensor, pendulum_names, start);
    REQUIRE(estimate.status != estimator::EstimateStatus::failed);  // what is left are the integrators' errors
    CHECK(estimate.scales.size() == 2);
    CHECK(estimate.scales[0].group == "prediction.phi");
    // Both are integrated, data to 1e-12 and prediction to 1e-9; frictions act a hundred times weaker than l.
    for (Eigen::Index i = 0; i < 4; ++i)
        CHECK(std::abs(values(estimate)[i] / truth[i] - 1.0) < 1e-5);

    // Over bounds, from where prediction alone has a false minimum.
    PredictionOptions options;
    options.sizes = coordinate_range(*c.system, c.series, {});
    const auto made = transitions(*c.system, c.base, c.series, c.sensor, {}, 1, 100, 0);
    const PredictionResidual residual({c.system}, binding, made, models::Clock::phase, start, options);
    const Eigen::VectorXd far = truth.cwiseProduct(Eigen::Vector4d(0.55, 1.0, 1.0, 1.0));
    const auto found = scanned_start([&](const Eigen::VectorXd& theta) { return residual.misfit(theta); }, far,
                                     0.01 * truth, 100.0 * truth, truth);
    CHECK(residual.misfit(found) < residual.misfit(far));
    CHECK(std::abs(found[0] / truth[0] - 1.0) < 0.07);  // half a rung of the ladder, 2^(1/12)
    CHECK(residual.misfit(truth) < 1e-6);
}

TEST_CASE("a recorded series gives its parameters back, from a bad start", "[orbits][shooting]") {
    const PendulumCase c(300, encoder(encoder_step), 4);
    const auto binding = bound(*c.system, c.base, pendulum_names);
    const Eigen::VectorXd truth = base_theta(binding);
    const Eigen::VectorXd start = truth.cwiseProduct(Eigen::Vector4d(1.45, 0.1, 3.0, 2.0));
    const auto first = predicted(c.system, binding, c.series, c.sensor, pendulum_names, start);
    REQUIRE(first.status == estimator::EstimateStatus::converged);
    CHECK(std::abs(values(first)[0] / truth[0] - 1.0) < 0.01);

    ShootingOptions options;
    options.sensor = c.sensor;
    options.start = values(first);
    ShootingResidual residual(c.system, binding, c.series, options);
    CHECK(residual.initial_set().is_intermediate_stage);
    CHECK_THAT(residual.groups()[0].floor, WithinAbs(encoder_step / std::sqrt(12.0), 1e-12));
    const auto estimate = estimator::estimate(parameters(pendulum_names, values(first)), {&residual}, {}, plain());
    CHECK(estimate.status == estimator::EstimateStatus::converged);
    const estimator::ActiveSet& active = estimate.active.front();
    CHECK_FALSE(active.is_intermediate_stage);
    CHECK(estimate.counts[0].lost == 0);
    for (Eigen::Index i = 0; i < 4; ++i) {
        CAPTURE(i, values(estimate)[i], truth[i], sds(estimate)[i]);
        CHECK(std::abs(values(estimate)[i] - truth[i]) < 4.0 * sds(estimate)[i]);
    }
    CHECK(sds(estimate)[0] < 1e-5 * truth[0]);
    CHECK(sds(estimate)[1] < 2e-2 * truth[1]);

    // Constraints instead of tight links: the same estimate; a thousandth of a sd is what both stop at.
    ShootingOptions exact = options;
    exact.matching.constraints = true;
    ShootingResidual constrained(c.system, binding, c.series, exact);
    const auto other = estimator::estimate(parameters(pendulum_names, values(first)), {&constrained}, {}, plain());
    CHECK(((values(other) - values(estimate)).array().abs() < 0.01 * sds(estimate).array()).all());
    CHECK(((sds(other) - sds(estimate)).array().abs() < 0.01 * sds(estimate).array()).all());

    // Nothing speaks against the right model.
    auto report = matching_report(residual, active, values(estimate), estimate.latents[0]);
    CHECK(report.defect.large == 0);
    CHECK(report.warnings.empty());
    auto loose = residual.with(looser(residual, active), active, estimate.latents[0], values(estimate));
    const auto second = estimator::estimate(parameters(pendulum_names, values(estimate)), {&loose}, {}, plain());
    compare(report, residual, active, pendulum_names, values(estimate), sds(estimate), values(second), sds(second));
    CHECK(report.shift.cwiseAbs().maxCoeff() < 3.0);
    CHECK(report.warnings.empty());
}

TEST_CASE("defects tell a wrong model", "[orbits][shooting]") {
    const PendulumCase c(300, encoder(encoder_step), 4);
    // The support moves as a pure cosine, not as a crank: a quarter of the forcing's second harmonic is missing.
    const auto harmonic = models::make_system("parametric_pendulum", "harmonic");
    const auto binding = bound(*harmonic, c.base, pendulum_names);
    ShootingOptions options;
    options.sensor = c.sensor;
    options.matching.kind = Continuity::Kind::student_t;
    options.matching.sd = Eigen::Vector2d(1e-4, 5e-4);
    ShootingResidual residual(harmonic, binding, c.series, options);
    const Eigen::VectorXd start = base_theta(binding);
    auto rough = plain();
    rough.maximum_iterations = 40;
    const auto estimate = estimator::estimate(parameters(pendulum_names, start), {&residual}, {}, rough);
    REQUIRE(estimate.status != estimator::EstimateStatus::failed);
    const auto report = matching_report(residual, estimate.active.front(), values(estimate), estimate.latents[0]);
    CHECK(report.defect.count == residual.layout().size() - c.series.segments.size());
    CHECK(report.defect.large > report.defect.count / 4);
    REQUIRE_FALSE(report.warnings.empty());
}

TEST_CASE("Lorenz' equations from noisy samples, without a hint", "[orbits][shooting]") {
    const auto system = models::make_system("lorenz");
    Eigen::VectorXd base = system->default_parameters();
    const std::vector<std::string> names{"sigma", "rho", "beta"};
    auto binding = bound(*system, base, names);
    const Eigen::Vector3d truth(10.0, 28.0, 2.66);
    base = binding.values(truth);
    VirtualExperimentOptions experiment;
    experiment.plan = SamplePlan{0.01, 3001, 0};
    experiment.initial = Eigen::Vector3d(1.0, 0.0, 0.0);
    experiment.noise = Eigen::Vector3d::Constant(0.5);
    experiment.seed = 5;
    const Series series = simulate(*system, base, experiment).series;
    const auto first = predicted(system, binding, series, {}, names, Eigen::Vector3d(1.0, 2.2, 0.2));
    REQUIRE(first.status != estimator::EstimateStatus::failed);
    ShootingOptions options;
    options.start = values(first);
    options.errors.assign(3, estimator::ErrorScale{false, 0.5, {}});
    ShootingResidual residual(system, binding, series, options);
    CHECK(residual.noise(residual.initial_set()) > noisy_readings);
    const auto estimate = estimator::estimate(parameters(names, values(first)), {&residual}, {}, plain());
    CHECK(estimate.status == estimator::EstimateStatus::converged);
    for (Eigen::Index i = 0; i < 3; ++i)
        CHECK(std::abs(values(estimate)[i] - truth[i]) < 4.0 * sds(estimate)[i]);
    // 9003 readings: sd of chi2 per value sqrt(2 / 9003) = 0.015.
    double chi2 = 0.0;
    std::size_t count = 0;
    for (std::size_t b = 0; b < residual.layout().size(); ++b) {
        const auto readings = residual.plan().of(b);
        for (std::size_t r = 0; r < readings.size(); ++r, ++count)
            chi2 += std::pow(estimate.residuals[0][b].e[static_cast<Eigen::Index>(r)] / 0.5, 2);
    }
    CHECK(count == 9003);
    CHECK_THAT(chi2 / static_cast<double>(count), WithinAbs(1.0, 0.06));

    // A matching sd that the data cannot tell from zero ends at its floor, and the intervals are those of exact
    // matching: within 14 % here. Let go to zero it lost the digits of the information, and sds came out half as large.
    options.errors.clear();
    options.matching.kind = Continuity::Kind::normal;
    options.matching.estimate = true;
    ShootingResidual loose(system, binding, series, options);
    const auto free = estimator::estimate(parameters(names, values(first)), {&loose}, {}, plain());
    CAPTURE(free.message);
    REQUIRE(free.status == estimator::EstimateStatus::converged);
    for (Eigen::Index i = 0; i < 3; ++i) {
        CAPTURE(i, values(free)[i], sds(free)[i], sds(estimate)[i]);
        CHECK(std::abs(values(free)[i] - truth[i]) < 4.0 * sds(free)[i]);
        CHECK_THAT(sds(free)[i], WithinRel(sds(estimate)[i], 0.3));
    }
}

TEST_CASE("errors of the model are told from errors of the readings", "[orbits][shooting]") {
    // Henon's map with a random push in every step: both are estimated.
    const auto system = models::make_system("henon");
    const Eigen::VectorXd base = system->default_parameters();
    constexpr double push = 0.005, reading = 0.01;
    estimator::RandomStream random(11, estimator::RandomPurpose::reading_noise, 0);
    Series series;
    for (const auto& coordinate : system->coordinates())
        series.coordinates.push_back({std::string(coordinate.name), std::string(coordinate.unit), false});
    Segment segment{"0", Eigen::MatrixXd(2, 600), {}, {}};
    Eigen::VectorXd x = Eigen::Vector2d(0.1, 0.1);
    const std::vector<double> one{1.0};
    for (Eigen::Index k = 0; k < 600; ++k) {
        for (Eigen::Index i = 0; i < 2; ++i)
            segment.values(i, k) = x[i] + reading * random.normal();
        x = system->flow(x, 0.0, one, base, models::Clock::time).states.col(0);
        for (Eigen::Index i = 0; i < 2; ++i)
            x[i] += push * random.normal();
    }
    series.segments.push_back(segment);
    std::vector<std::string> names;
    for (const auto& parameter : system->parameters())
        names.emplace_back(parameter.name);
    const auto binding = bound(*system, base, names);
    const Eigen::VectorXd truth = base_theta(binding);
    ShootingOptions options;
    options.matching.kind = Continuity::Kind::normal;
    options.matching.estimate = true;
    options.start = 0.9 * truth;
    ShootingResidual residual(system, binding, series, options);
    const auto estimate = estimator::estimate(parameters(names, options.start), {&residual}, {}, plain());
    CAPTURE(estimate.message);
    REQUIRE(estimate.status == estimator::EstimateStatus::converged);
    for (Eigen::Index i = 0; i < truth.size(); ++i)
        CHECK(std::abs(values(estimate)[i] - truth[i]) < 4.0 * sds(estimate)[i]);
    REQUIRE(estimate.scales.size() == 4);
    for (std::size_t g = 0; g < 4; ++g) {
        CAPTURE(estimate.scales[g].group, estimate.scales[g].value, estimate.scales[g].uncertainty);
        CHECK(std::abs(estimate.scales[g].value - (g < 2 ? reading : push)) < 4.0 * estimate.scales[g].uncertainty);
        CHECK(estimate.scales[g].uncertainty < 0.5 * estimate.scales[g].value);
    }
}

TEST_CASE("a transient that ends at rest keeps its tail", "[orbits][shooting]") {
    // So little forcing that dry friction stops the pendulum: the flow sticks, X is singular, and readings still count.
    const auto system = models::make_system("parametric_pendulum");
    Eigen::VectorXd base = system->default_parameters();
    base[system->parameter_index("k1")] = 2e-2;
    base[system->parameter_index("A")] = 0.01;
    VirtualExperimentOptions experiment;
    experiment.plan = SectionPlan{40, 0, {}, 0.0};
    experiment.trajectories = 2;
    experiment.initial.resize(2, 2);
    experiment.initial << 2.5, -1.2, 3.0, 9.0;
    experiment.restart = Restart::never;
    experiment.sensor = encoder(encoder_step);
    const Series series = simulate(*system, base, experiment).series;
    REQUIRE(series.segments.size() == 2);
    const auto last = series.segments[0].values.cols() - 1;
    REQUIRE(series.segments[0].values(1, last) == 0.0);
    const auto binding = bound(*system, base, pendulum_names);
    const Eigen::VectorXd truth = base_theta(binding);
    ShootingOptions options;
    options.sensor = experiment.sensor;
    options.start = truth.cwiseProduct(Eigen::Vector4d(1.02, 1.1, 0.8, 1.2));
    ShootingResidual residual(system, binding, series, options);
    for (const auto& value : residual.evaluate(residual.initial_set(), options.start, residual.initial_latents(), true))
        CHECK(value.status == estimator::BlockStatus::ok);
    const auto estimate = estimator::estimate(parameters(pendulum_names, options.start), {&residual}, {}, plain());
    REQUIRE(estimate.status != estimator::EstimateStatus::failed);
    CHECK(estimate.counts[0].lost == 0);
    CHECK(std::abs(values(estimate)[0] - truth[0]) < 4.0 * sds(estimate)[0]);
    CHECK(std::abs(values(estimate)[1] - truth[1]) < 4.0 * sds(estimate)[1]);
}

TEST_CASE("one node that cannot be simulated fails alone", "[orbits][shooting]") {
    const PendulumCase c(30, {});
    const auto binding = bound(*c.system, c.base, pendulum_names);
    ShootingOptions options;
    const ShootingResidual residual(c.system, binding, c.series, options);
    auto latents = residual.initial_latents();
    latents[7][0] = std::numeric_limits<double>::quiet_NaN();
    const auto blocks = residual.evaluate(residual.initial_set(), base_theta(binding), latents, true);
    for (std::size_t b = 0; b < blocks.size(); ++b)
        CHECK((blocks[b].status == estimator::BlockStatus::failed) == (b == 6 || b == 7));
    Eigen::VectorXd outside = base_theta(binding);
    outside[0] = -1.0;  // a length must be > 0
    for (const auto& block : residual.evaluate(residual.initial_set(), outside, residual.initial_latents(), false))
        CHECK(block.status == estimator::BlockStatus::failed);
}

}  // namespace shooting_estimation_test

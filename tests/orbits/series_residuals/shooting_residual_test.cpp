#include "orbits/series_residuals/shooting_residual.hpp"

#include <limits>

#include "orbits/simulation/node_state.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/series_residuals/shooting_case.hpp"

namespace shooting_residual_test {

using namespace orbid;
using namespace orbid::orbits;
using tests::base_theta;
using tests::bound;
using tests::ContainsSubstring;
using tests::derivative_error;
using tests::encoder;
using tests::PendulumCase;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

Series samples(const models::System& system, const Eigen::VectorXd& theta, double step, std::size_t count,
               const Eigen::VectorXd& start, const models::Sensor& sensor = {}) {
    VirtualExperimentOptions options;
    options.plan = SamplePlan{step, count, 0};
    options.initial = start;
    options.sensor = sensor;
    options.phase = 0.4;
    return simulate(system, theta, options).series;
}

Eigen::VectorXd lorenz_parameters(const models::System& system) {
    Eigen::VectorXd theta = system.default_parameters();
    theta[system.parameter_index("beta")] = 2.66;
    return theta;
}

}  // namespace

TEST_CASE("readings of an encoder are inverted to the states they were taken of", "[orbits][shooting]") {
    // Without rounding the inversion is exact up to the integrator: 1e-9 at its tolerance of 1e-12 times the Newton
    // steps' own limit.
    const PendulumCase read(40, encoder(0.0));
    const PendulumCase state(40, {});
    const Segment& segment = read.series.segments[0];
    std::vector<Eigen::Index> columns;
    for (Eigen::Index k = 0; k < segment.values.cols(); ++k)
        columns.push_back(k);
    const Eigen::MatrixXd states = node_states(*read.system, read.base, read.series, 0, read.sensor, columns);
    REQUIRE(states.cols() == state.series.segments[0].values.cols());
    CHECK((segment.values.row(1) - state.series.segments[0].values.row(1)).cwiseAbs().maxCoeff() > 1e-2);
    CHECK((states - state.series.segments[0].values).cwiseAbs().maxCoeff() < 1e-9);
}

TEST_CASE("a section series is met exactly by its own parameters and states", "[orbits][shooting]") {
    PendulumCase c(60, encoder(0.0));
    c.series.segments[0].values(1, 7) = std::numeric_limits<double>::quiet_NaN();
    ShootingOptions options;
    options.sensor = c.sensor;
    options.matching.kind = Continuity::Kind::normal;
    options.matching.sd = Eigen::Vector2d(1e-9, 5e-9);  // the flow is as accurate as that asks for
    const auto binding = bound(*c.system, c.base, {"l", "k1", "k2", "k3"});
    const ShootingResidual residual(c.system, binding, c.series, options);
    CHECK(residual.interval() == 1);
    REQUIRE(residual.groups().size() == 3);
    CHECK(residual.groups()[0].name == "series.phi");
    CHECK(residual.groups()[1].name == "series.matching.phi");
    CHECK(residual.groups()[2].unit == "rad/s");
    CHECK_FALSE(residual.groups()[1].scale.estimate);
    const auto& layout = residual.layout();
    const std::size_t nodes = layout.size();
    REQUIRE(nodes == c.series.size());
    CHECK(layout[0].group == std::vector<int>{0, 0, 1, 2});
    CHECK(layout[0].linked_from == 2);
    CHECK(layout[0].next == 1);
    CHECK(layout[7].group == std::vector<int>{0, 1, 2});  // the second reading is missing
    CHECK(layout[nodes - 1].next == -1);
    CHECK(layout[nodes - 1].linked_from == -1);

    const Eigen::VectorXd theta = base_theta(binding);
    auto latents = residual.initial_latents();
    const auto values = residual.evaluate(residual.initial_set(), theta, latents, false);
    for (const auto& value : values) {
        REQUIRE(value.status == estimator::BlockStatus::ok);
        CHECK(value.e.cwiseAbs().maxCoeff() < 1e-8);  // growth of an inverted state's 1e-10 over a period: up to 40
    }
    const auto defect = residual.defect(residual.initial_set(), theta, latents, Eigen::Vector2d(1e-6, 1e-6));
    CHECK(defect.count == nodes - 1);
    CHECK(defect.large == 0);
    latents[5][1] += 1e-3;
    CHECK(residual.defect(residual.initial_set(), theta, latents, Eigen::Vector2d(1e-6, 1e-6)).large ==
          2);  // before and behind it
    CHECK(derivative_error(residual, theta, latents) < 1e-5);
}

TEST_CASE("derivatives to the frequency of the forcing are complete", "[orbits][shooting]") {
    SECTION("sections read by an encoder") {
        const PendulumCase c(20, encoder(0.0));
        ShootingOptions options;
        options.sensor = c.sensor;
        const auto binding = bound(*c.system, c.base, {"omega", "l", "g"});
        const ShootingResidual residual(c.system, binding, c.series, options);
        CHECK(derivative_error(residual, base_theta(binding), residual.initial_latents()) < 1e-5);
    }
    SECTION("samples in time, several to an interval") {
        const auto system = models::make_system("parametric_pendulum");
        const Eigen::VectorXd base = system->default_parameters();
        for (const models::Sensor& sensor : {models::Sensor(), encoder(0.0)}) {
            ShootingOptions options;
            options.sensor = sensor;
            options.interval = 3;
            const Series series = samples(*system, base, 0.05, 25, Eigen::Vector2d(0.7, 3.0), sensor);
            const auto binding = bound(*system, base, {"k2", "omega"});
            const ShootingResidual residual(system, binding, series, options);
            CHECK(residual.layout().size() == 9);
            CHECK(derivative_error(residual, base_theta(binding), residual.initial_latents()) < 1e-5);
        }
    }
}

TEST_CASE("samples of an autonomous flow are matched interval by interval", "[orbits][shooting]") {
    const auto system = models::make_system("lorenz");
    const Eigen::VectorXd base = lorenz_parameters(*system);
    Series series = samples(*system, base, 0.01, 102, Eigen::Vector3d(1.0, 0.0, 0.0));
    series.segments[0].values(2, 10) = std::numeric_limits<double>::quiet_NaN();
    const auto binding = bound(*system, base, {"sigma", "rho", "beta"});
    for (const bool constraints : {true, false}) {
        ShootingOptions options;
        options.interval = 10;
        options.matching.constraints = constraints;
        const ShootingResidual residual(system, binding, series, options);
        REQUIRE(residual.layout().size() == 11);
        // Two samples are left for the last node, the 11th of the first interval is the next node's.
        CHECK(residual.layout()[10].group.size() == 6);
        CHECK(residual.layout()[0].group.size() == (constraints ? 30 : 33));
        CHECK(residual.layout()[1].group.size() == (constraints ? 29 : 32));
        CHECK(residual.layout()[0].constraints == (constraints ? 3 : 0));
        const auto latents = residual.initial_latents();
        // Node 1 (sample 10) lacks z, and has it from a cubic through its successors: 1e-2 of the true one.
        CHECK(derivative_error(residual, base_theta(binding), latents) < 1e-5);
        const auto values = residual.evaluate(residual.initial_set(), base_theta(binding), latents, false);
        CHECK(values[5].e.cwiseAbs().maxCoeff() < 1e-8);
    }
    // On the attractor errors grow by a factor e within some tenths of a second (largest exponent 0.9 per second, but
    // uneven in time and direction).
    const Series longer = samples(*system, base, 0.01, 1500, Eigen::Vector3d(8.0, -3.0, 35.0));
    const ShootingResidual chosen(system, binding, longer, {});
    CHECK(chosen.interval() >= 5);
    CHECK(chosen.interval() <= 60);
}

TEST_CASE("iterates of a map are matched", "[orbits][shooting]") {
    const auto system = models::make_system("henon");
    const Eigen::VectorXd base = system->default_parameters();
    VirtualExperimentOptions experiment;
    experiment.plan = SectionPlan{50, 100, {}, 0.0};
    experiment.initial = Eigen::Vector2d(0.1, 0.1);
    const Series series = simulate(*system, base, experiment).series;
    ShootingOptions options;
    options.interval = 2;
    std::vector<std::string> names;
    for (const auto& parameter : system->parameters())
        names.emplace_back(parameter.name);
    const auto binding = bound(*system, base, names);
    const ShootingResidual residual(system, binding, series, options);
    CHECK(residual.layout().size() == 25);
    const auto latents = residual.initial_latents();
    for (const auto& value : residual.evaluate(residual.initial_set(), base_theta(binding), latents, false))
        CHECK(value.e.cwiseAbs().maxCoeff() < 1e-12);
    CHECK(derivative_error(residual, base_theta(binding), latents) < 1e-6);
}

TEST_CASE("shooting refuses what it cannot match", "[orbits][shooting]") {
    const auto system = models::make_system("lorenz");
    const Eigen::VectorXd base = lorenz_parameters(*system);
    const Series series = samples(*system, base, 0.01, 20, Eigen::Vector3d(1.0, 0.0, 0.0));
    const auto binding = bound(*system, base, {"rho"});
    const auto refused = [&](Series s, const ShootingOptions& options, const std::string& why) {
        CHECK_THROWS_WITH(ShootingResidual(system, binding, std::move(s), options), ContainsSubstring(why));
    };
    ShootingOptions options;
    options.interval = -1;
    refused(series, options, "interval is -1");
    options = {};
    options.observe = {"x", "x"};
    refused(series, options, "observed twice");
    options.observe = {"u"};
    refused(series, options, "no coordinate u");
    options = {};
    options.segments = {3};
    refused(series, options, "segment 3 does not exist");
    options = {};
    options.forms.assign(3, ErrorForm{estimator::AutoregressiveErrors{}, 0.0, false});
    refused(series, options, "begin anew at every node");
    options = {};
    options.forms.assign(3, ErrorForm{estimator::NormalErrors{}, 0.0, true});
    refused(series, options, "has no known sd > 0");
    options = {};
    // y begins at 0, which is no reading of a positive quantity.
    options.forms.assign(3, ErrorForm{});
    options.forms[1].distribution = estimator::LogNormalErrors{};
    refused(series, options, "log-normal errors of y: reading 0 is 0, must be > 0");
    options = {};
    options.matching.kind = Continuity::Kind::normal;
    refused(series, options, "needs its sds");
    options.matching.sd = Eigen::Vector2d(1.0, 1.0);
    refused(series, options, "2 matching sds for 3");
    options.matching.sd = Eigen::Vector3d(1.0, 0.0, 1.0);
    refused(series, options, "must be > 0");
    options.matching = {};
    options.matching.estimate = true;
    refused(series, options, "no sd that could be estimated");
    Series sections = series;
    sections.sampling = Series::Sampling::section;
    sections.segments[0].times.resize(0);
    refused(sections, {}, "need their times");
    Series empty = series;
    empty.segments[0].values.setConstant(std::numeric_limits<double>::quiet_NaN());
    refused(empty, {}, "has no reading");
    options = {};
    options.nodes = {Eigen::MatrixXd::Zero(3, 2)};
    options.interval = 10;
    CHECK_NOTHROW(ShootingResidual(system, binding, series, options));
    options.nodes = {Eigen::MatrixXd::Zero(2, 2)};
    refused(series, options, "given are 2 of 2");
}

}  // namespace shooting_residual_test

// Predictions of orbits and branches with bands: against closed forms of the linear oscillator, and against folds that
// are solved anew at other parameters.
#include "identification/prediction/predicted_motion.hpp"

#include <cmath>
#include <complex>

#include "periodic/solution/solve_orbit.hpp"
#include "tests/periodic/orbit/steady_state.hpp"

namespace predicted_motion_test {

using namespace orbid;
using namespace orbid::tests;
using Eigen::Index;
using Eigen::VectorXd;
using identification::ParameterPosterior;
using periodic::OrbitMeasure;
using periodic::OrbitStatus;

namespace {

constexpr double normal95 = 1.959963984540054;

/// Normal in the logarithms of the parameters, independent of each other, with these relative sds.
ParameterPosterior posterior_of(const models::System& system, const VectorXd& values,
                                const std::vector<std::pair<std::string_view, double>>& relative_sds) {
    ParameterPosterior posterior;
    posterior.values = values;
    const auto f = std::ssize(relative_sds);
    posterior.covariance = Eigen::MatrixXd::Zero(f, f);
    for (Index i = 0; i < f; ++i) {
        const auto& [name, sd] = relative_sds[static_cast<std::size_t>(i)];
        posterior.parameters.push_back(system.parameter_index(name));
        estimator::FreeParameter free;
        free.name = name;
        free.scale = estimator::Scale::log;
        free.lower = 0.0;
        posterior.estimated.push_back(free);
        const double natural = sd * values(posterior.parameters.back());
        posterior.covariance(i, i) = natural * natural;
    }
    return posterior;
}

periodic::StartingSolution started(double x, double v) {
    periodic::StartingSolution start;
    start.points = Eigen::Vector2d(x, v);
    return start;
}

periodic::ContinuationOptions over_omega(const models::System& system, double lower, double upper) {
    periodic::ContinuationOptions options;
    options.parameter = system.parameter_index("omega");
    options.lower = lower;
    options.upper = upper;
    options.solver.maximum_distance = 100.0;
    return options;
}

/// Duffing's equation with a hardening spring: stable, unstable and stable orbits between its folds at 1.19 and 1.33.
VectorXd duffing_values(const models::System& system) {
    return with_values(system, {{"alpha", 1.0}, {"beta", 0.2}, {"delta", 0.1}, {"gamma", 0.3}, {"omega", 1.0}});
}

}  // namespace

TEST_CASE("draws have the mean, the covariance and the scale of the estimate", "[identification][prediction]") {
    const auto system = models::make_system("duffing", "");
    const VectorXd values = duffing_values(*system);
    ParameterPosterior posterior = posterior_of(*system, values, {{"delta", 0.3}, {"gamma", 0.1}});
    posterior.covariance(0, 1) = posterior.covariance(1, 0) = 0.6 * 0.3 * 0.1 * 0.1 * 0.3;
    constexpr Index count = 4000;
    const auto draws = draw_parameters(*system, posterior, count, 7);
    CHECK(draws.outside == 0);
    CHECK_FALSE(draws.from_sample);
    const Index delta = system->parameter_index("delta"), gamma = system->parameter_index("gamma");
    const VectorXd a = (draws.values.row(delta).array() / 0.1).log() / 0.3;
    const VectorXd b = (draws.values.row(gamma).array() / 0.3).log() / 0.1;
    // Four errors of a mean of 4000 standard normal numbers; of a variance and a correlation likewise.
    CHECK(std::abs(a.mean()) < 0.064);
    CHECK(std::abs(b.mean()) < 0.064);
    CHECK(std::abs(a.squaredNorm() / count - 1.0) < 0.09);
    CHECK(std::abs(b.squaredNorm() / count - 1.0) < 0.09);
    CHECK(std::abs(a.dot(b) / count - 0.6) < 0.075);
    CHECK(draws.values.row(system->parameter_index("beta")).minCoeff() == 0.2);
    // The same seed, the same draws; parameters that are held keep their value.
    CHECK(draw_parameters(*system, posterior, count, 7).values == draws.values);
    CHECK(draw_parameters(*system, posterior, 10, 7, {delta}).values.row(delta).maxCoeff() == 0.1);
    // Bounds are kept, and what lies beyond them is counted.
    posterior.estimated[0].upper = 0.1;
    const auto bounded = draw_parameters(*system, posterior, 1000, 7);
    CHECK(bounded.values.row(delta).maxCoeff() <= 0.1);
    CHECK(std::abs(static_cast<double>(bounded.outside) - 1000.0) < 200.0);
    // A sample goes before the covariance.
    posterior.sample = Eigen::MatrixXd::Random(2, 50);
    const auto sampled = draw_parameters(*system, posterior, 25, 7);
    CHECK(sampled.from_sample);
    CHECK(sampled.values(delta, 0) == posterior.sample(0, 1));
    CHECK(draw_parameters(*system, posterior, 80, 7).values.cols() == 50);
    posterior.sample.resize(0, 0);
    posterior.covariance.resize(0, 0);
    CHECK_THROWS_AS(draw_parameters(*system, posterior, 10, 7), std::invalid_argument);
}

TEST_CASE("an orbit of the linear oscillator has the band of its closed form", "[identification][prediction]") {
    const auto system = models::make_system("duffing", "");
    const double alpha = 2.0, delta = 0.4;
    const VectorXd values =
        with_values(*system, {{"alpha", alpha}, {"beta", 0.0}, {"delta", delta}, {"gamma", 1.3}, {"omega", 1.7}});
    const ParameterPosterior posterior = posterior_of(*system, values, {{"gamma", 0.2}});
    const auto draws = draw_parameters(*system, posterior, 2000, 3);
    VectorXd to = values;
    to(system->parameter_index("omega")) = 1.2;
    const auto names = models::reading_names(system->coordinates(), system->parameters());
    const auto predicted = predict_orbit(*system, posterior, draws, started(0.0, 0.0), to,
                                         {{"square", "m^2", models::Expression::parse("x^2", names)}});
    REQUIRE(predicted.orbit.status == OrbitStatus::converged);
    const double a = 1.3 / std::abs(std::complex<double>(alpha - 1.2 * 1.2, delta * 1.2));
    const auto& all = predicted.quantities;
    const Index half_range = predicted.layout.of_measure(OrbitMeasure::half_range, 0);
    CHECK(all.found == 2000);
    CHECK(all.stable == 1.0);
    CHECK_THAT(all.value(half_range), WithinAbs(a, 1e-9));
    // The amplitude is proportional to gamma: log-normal with log sd 0.2. Quantiles of 2000 draws: 2 % of the value.
    CHECK_THAT(all.delta_sd(half_range), WithinRel(0.2 * a, 1e-7));
    CHECK_THAT(all.lower95(half_range), WithinRel(a * std::exp(-0.2 * normal95), 0.04));
    CHECK_THAT(all.upper95(half_range), WithinRel(a * std::exp(0.2 * normal95), 0.04));
    CHECK_THAT(all.sd(half_range), WithinRel(a * std::exp(0.02) * std::sqrt(std::exp(0.04) - 1.0), 0.06));
    // A formula beside the coordinates: the mean square, with twice the log sd.
    const Index square = predicted.layout.of_measure(OrbitMeasure::mean, 2);
    CHECK_THAT(all.value(square), WithinAbs(0.5 * a * a, 1e-9));
    CHECK_THAT(all.delta_sd(square), WithinRel(0.4 * 0.5 * a * a, 1e-7));
    // The frequency of the forcing is known; so is the multiplier, exp(-delta T / 2).
    CHECK_THAT(all.value(predicted.layout.frequency()), WithinRel(1.2 / (2.0 * std::numbers::pi), 1e-12));
    CHECK(all.delta_sd(predicted.layout.frequency()) == 0.0);
    CHECK_THAT(all.value(predicted.layout.multiplier()),
               WithinRel(std::exp(-0.5 * delta * 2.0 * std::numbers::pi / 1.2), 1e-8));
    // The points move with gamma, too.
    const Index point = predicted.layout.first_point();
    CHECK_THAT(all.delta_sd(point), WithinRel(0.2 * std::abs(all.value(point)), 1e-7));
    // Without draws the intervals are normal.
    const auto none = draw_parameters(*system, posterior, 0, 3);
    const auto normal = predict_orbit(*system, posterior, none, started(0.0, 0.0), to, {});
    CHECK_THAT(normal.quantities.upper95(half_range), WithinRel(a * (1.0 + 0.2 * normal95), 1e-7));
    // A parameter that the question sets is held.
    VectorXd held = to;
    held(system->parameter_index("gamma")) = 2.6;
    const auto fixed = predict_orbit(*system, posterior, draws, started(0.0, 0.0), held, {});
    CHECK_THAT(fixed.quantities.value(half_range), WithinAbs(2.0 * a, 1e-9));
    CHECK(fixed.quantities.sd(half_range) < 1e-9);
}

TEST_CASE("bands of a branch with folds are those of branches solved anew", "[identification][prediction]") {
    const auto system = models::make_system("duffing", "");
    const VectorXd values = duffing_values(*system);
    const ParameterPosterior posterior = posterior_of(*system, values, {{"gamma", 0.02}});
    const auto draws = draw_parameters(*system, posterior, 60, 5);
    const auto options = over_omega(*system, 0.6, 1.8);
    const auto predicted = predict_branch(*system, posterior, draws, started(1.0, 0.0), options, {});
    REQUIRE(predicted.start == OrbitStatus::converged);
    CHECK(predicted.followed == 60);
    // Two folds, on the way to larger frequencies: 1.33262 and 1.19395.
    std::vector<const identification::PredictedMark*> folds;
    for (const auto& mark : predicted.marks)
        if (mark.mark.kind == "fold") folds.push_back(&mark);
    REQUIRE(folds.size() == 2);
    CHECK_THAT(folds[0]->mark.parameter, WithinAbs(1.33262104399, 1e-8));
    CHECK_THAT(folds[1]->mark.parameter, WithinAbs(1.19395478455, 1e-8));
    // They move with gamma as those of branches at other values of it.
    const auto fold_at = [&](double share, std::size_t which) {
        ParameterPosterior moved = posterior;
        moved.values(system->parameter_index("gamma")) *= share;
        const auto none = draw_parameters(*system, moved, 0, 5);
        const auto branch = predict_branch(*system, moved, none, started(1.0, 0.0), options, {});
        std::size_t seen = 0;
        for (const auto& mark : branch.marks)
            if (mark.mark.kind == "fold" && seen++ == which) return mark.mark.parameter;
        FAIL("a fold is missing");
        return 0.0;
    };
    for (const std::size_t which : {0u, 1u}) {
        const double sd = std::abs(fold_at(std::exp(0.02), which) - fold_at(std::exp(-0.02), which)) / 2.0;
        // The sd of 60 draws: 9 % of it, three of these.
        CHECK_THAT(folds[which]->parameter.sd(0), WithinRel(sd, 0.3));
        CHECK(folds[which]->parameter.found == 60);
    }
    // On each sheet a draw's value at 1.25 is that of its own orbit, found from there.
    const auto sheets = sheets_of(predicted, 1.0);
    CHECK(sheets.range() == std::pair{0, 2});
    const Index half_range = predicted.layout.of_measure(OrbitMeasure::half_range, 0);
    double last = 10.0;
    for (int sheet = 0; sheet <= 2; ++sheet) {
        CAPTURE(sheet);
        const auto all = quantities_at(predicted, sheets, sheet, 1.25);
        REQUIRE(all.value.size() > 0);
        CHECK(all.found == 60);
        CHECK(all.stable == (sheet == 1 ? 0.0 : 1.0));
        // Harmonic balance: ((alpha - w^2 + 3/4 beta A^2)^2 + (delta w)^2) A^2 = gamma^2, to the third harmonic.
        const double a = all.value(half_range);
        CHECK(a < last);
        last = a;
        const double stiffness = 1.0 - 1.25 * 1.25 + 0.15 * a * a;
        CHECK_THAT(a * std::hypot(stiffness, 0.125), WithinRel(0.3, 0.1));
        // d A / d ln gamma from the same balance: gamma^2 / (A d(gamma^2)/d(A^2)) to first order.
        const double slope = 0.09 / (a * (stiffness * stiffness + 0.125 * 0.125 + 0.3 * a * a * stiffness));
        CHECK_THAT(all.sd(half_range), WithinRel(0.02 * std::abs(slope), 0.4));
    }
    // Nothing beyond the folds, and fewer draws near them.
    CHECK(quantities_at(predicted, sheets, 0, 1.5).value.size() == 0);
    const auto near = quantities_at(predicted, sheets, 0, 1.3320);
    CHECK(near.found < 60);
    CHECK(near.found > 10);
}

TEST_CASE("interpolated orbits of a branch are those that Newton's method finds", "[identification][prediction]") {
    const auto system = models::make_system("duffing", "");
    const VectorXd values = duffing_values(*system);
    const ParameterPosterior posterior = posterior_of(*system, values, {{"gamma", 0.02}});
    const auto none = draw_parameters(*system, posterior, 0, 5);
    const auto predicted =
        predict_branch(*system, posterior, none, started(1.0, 0.0), over_omega(*system, 0.6, 1.8), {});
    const auto sheets = sheets_of(predicted, 1.0);
    std::size_t compared = 0;
    for (std::size_t k = 1; k < predicted.branch.points.size(); ++k) {
        const auto& a = predicted.branch.points[k - 1];
        const auto& b = predicted.branch.points[k];
        if (predicted.sheets[k - 1] != predicted.sheets[k] || a.parameter == b.parameter) continue;
        VectorXd there = values;
        const double at = 0.5 * (a.parameter + b.parameter);
        there(system->parameter_index("omega")) = at;
        periodic::StartingSolution start;
        start.points = 0.5 * (a.orbit.points + b.orbit.points);
        const auto orbit = periodic::solve_orbit(*system, there, start, {}, periodic::ShootingOptions{});
        if (orbit.status != OrbitStatus::converged) continue;
        const auto amplitude = periodic::amplitude_of(*system, there, 0.0, orbit, {});
        const auto value = sheets.at(predicted.sheets[k], at, 1);
        REQUIRE(value);
        // Cubic interpolation over steps of some 5e-2: measured 1.1e-4 at most.
        CHECK_THAT((*value)(predicted.layout.of_measure(OrbitMeasure::half_range, 0)),
                   WithinRel(amplitude.half_range(0), 1e-3));
        ++compared;
    }
    CHECK(compared > 20);
}

}  // namespace predicted_motion_test

// The long-run variance of scores against closed forms: autoregressions, ringing, moving averages; its bias and degrees
// of freedom against dense matrices; coverage; profile, marginal and sample that agree with the table.

#include <cmath>
#include <complex>
#include <numbers>
#include <random>
#include <vector>

#include "estimator/exploration/marginal.hpp"
#include "estimator/exploration/profile.hpp"
#include "estimator/sampling/posterior_sample.hpp"
#include "estimator/uncertainty/score_spectrum.hpp"
#include "estimator/uncertainty/spectral_shape.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::score_spectrum_test {

namespace {

/// x_t = first x_{t-1} + second x_{t-2} + e_t + moved e_{t-1}, e of sd 1, after 2000 steps from rest.
struct Process {
    const char* name;
    double first, second, moved;

    [[nodiscard]] double long_run_variance() const { return std::pow((1.0 + moved) / (1.0 - first - second), 2); }

    [[nodiscard]] Eigen::VectorXd simulated(Eigen::Index n, unsigned seed) const {
        std::mt19937_64 generator(seed);
        std::normal_distribution<double> normal;
        Eigen::VectorXd values(n);
        double x = 0.0, before = 0.0, e = 0.0;
        for (Eigen::Index i = -2000; i < n; ++i) {
            const double next = normal(generator);
            const double value = first * x + second * before + next + moved * e;
            before = x;
            x = value;
            e = next;
            if (i >= 0) values[i] = value;
        }
        return values;
    }
};

/// A ring of 5 records per turn that loses 5 per cent per record.
const Process ringing{"ringing", 2.0 * 0.95 * std::cos(2.0 * std::numbers::pi / 5.0), -0.95 * 0.95, 0.0};

Eigen::VectorXd midpoints(Eigen::Index n) {
    return Eigen::VectorXd::LinSpaced(n, 0.5, static_cast<double>(n) - 0.5);
}

/// A constant fitted to these values.
estimator::ScoreSpectrum mean_of(const Eigen::VectorXd& values) {
    const auto n = static_cast<double>(values.size());
    estimator::ScoreRows rows;
    rows.sensitivity = Eigen::MatrixXd::Constant(values.size(), 1, 1.0 / std::sqrt(n));
    rows.latent.resize(values.size(), 0);
    rows.residual = values.array() - values.mean();
    rows.time = midpoints(values.size());
    return estimator::ScoreSpectrum({rows}, n, 1.0);
}

/// y = a + b x with errors of a process, one ordered record.
struct Line {
    Eigen::MatrixXd x;
    FunctionResidual residual;
    std::vector<estimator::FreeParameter> parameters{free_parameter("a", 0.0), free_parameter("b", 0.0)};

    Line(const Process& process, Eigen::Index n, unsigned seed) : x(n, 2) {
        x << Eigen::VectorXd::Ones(n), Eigen::VectorXd::LinSpaced(n, -1.0, 1.0);
        const Eigen::VectorXd y = x * Eigen::Vector2d(1.0, 2.0) + 0.1 * process.simulated(n, seed);
        estimator::Group ordered = group("y");
        ordered.ordered = true;
        ordered.interval = 1.0;
        residual.add_group(ordered);
        residual.add_block(layout("record", n), linear(y, x));
    }
};

}  // namespace

TEST_CASE("spectral shape: autoregressions in closed form", "[estimator]") {
    for (const Process& process : {Process{"first order", 0.9, 0.0, 0.0}, ringing}) {
        CAPTURE(process.name);
        constexpr Eigen::Index n = 200000;
        const auto shape = estimator::spectral_shape(process.simulated(n, 5), n / 40);
        double sum = 0.0;
        for (Eigen::Index j = 1; j <= n / 40; ++j) {
            const std::complex<double> step = std::polar(1.0, -std::numbers::pi * static_cast<double>(j) / n);
            sum += 1.0 / process.long_run_variance() /
                   std::norm(1.0 - process.first * step - process.second * step * step);
            // sd of a coefficient at most 1 / sqrt(n) = 0.0022; of 1 - phi = 0.1 four of them are 10 per cent.
            if (j % 500 == 0)
                CHECK_THAT(shape[static_cast<std::size_t>(j - 1)], WithinRel(sum / static_cast<double>(j), 0.1));
        }
        CHECK(estimator::flat_frequencies(shape, 0.06) > 1);
    }
    CHECK(estimator::spectral_shape(Eigen::VectorXd::Zero(100), 9) == std::vector<double>(9, 1.0));
    CHECK(estimator::flat_frequencies({1.0, 0.95, 0.9, 1.0}, 0.06) == 2);
    CHECK(estimator::flat_frequencies({0.5}, 0.06) == 1);
    CHECK(estimator::flat_frequencies({1.0, std::nan("")}, 0.06) == 1);
}

TEST_CASE("long-run variance: autoregression, ringing and moving average in closed form", "[estimator]") {
    for (const Process& process : {Process{"white", 0.0, 0.0, 0.0}, Process{"first order", 0.9, 0.0, 0.0}, ringing,
                                   Process{"sum", 0.0, 0.0, 0.8}, Process{"difference", 0.0, 0.0, -0.6}}) {
        constexpr int runs = 100;
        double sum = 0.0;
        for (unsigned run = 0; run < runs; ++run)
            sum += mean_of(process.simulated(4000, 10 + run)).along(Eigen::VectorXd::Ones(1)).value;
        CAPTURE(process.name, sum / runs, process.long_run_variance());
        // Mean of 100 over 20 or more frequencies: sd 3.2 per cent, three of them and the 6 per cent of the flat band.
        CHECK_THAT(sum / runs, WithinRel(process.long_run_variance(), 0.16));
    }
}

TEST_CASE("long-run variance of independent errors: no bias, degrees of freedom written with records", "[estimator]") {
    // 7 steps of 9 records each leave two frequencies whatever the scores; one parameter and one latent state are
    // fitted.
    constexpr Eigen::Index n = 63;
    std::mt19937_64 generator(3);
    std::normal_distribution<double> normal;
    const Eigen::VectorXd z = Eigen::VectorXd::NullaryExpr(n, [&] { return normal(generator); }).normalized();
    Eigen::VectorXd x = Eigen::VectorXd::NullaryExpr(n, [&] { return 1.0 + normal(generator); });
    x = (x - z * z.dot(x)).normalized();
    const Eigen::MatrixXd rest = Eigen::MatrixXd::Identity(n, n) - z * z.transpose() - x * x.transpose();
    const Eigen::VectorXd time = midpoints(n) / 9.0;
    Eigen::MatrixXd weights(n, 2);
    for (int j = 1; j <= 2; ++j)
        weights.col(j - 1) = (std::numbers::pi * j / 7.0 * time.array()).cos() * x.array();
    const Eigen::Matrix2d expected = weights.transpose() * rest * weights;
    double sum = 0.0;
    for (Eigen::Index i = 0; i < n; ++i) {
        const estimator::ScoreSpectrum spectrum({{x, z, rest.col(i), time}}, 7.0, 1.0);
        const auto ratio = spectrum.along(Eigen::VectorXd::Constant(1, 1.7));
        REQUIRE(ratio.frequencies == 2);
        CHECK(ratio.enough);
        CHECK_THAT(ratio.value, WithinRel((weights.transpose() * rest.col(i)).squaredNorm() / expected.trace(), 1e-10));
        CHECK_THAT(ratio.degrees_of_freedom,
                   WithinRel(expected.trace() * expected.trace() / expected.squaredNorm(), 1e-10));
        sum += ratio.value;
    }
    // A sum over an orthonormal basis of errors is their expectation.
    CHECK_THAT(sum, WithinRel(1.0, 1e-10));
}

// 400 replicates: 380 expected, binomial sd 4.4; four of them to both sides and the 3 per cent of the sd that the band
// allows (0.8 per cent of coverage) are 359 and 397.
TEST_CASE("intervals cover with ringing and with persistent errors", "[estimator]") {
    for (const Process& process : {ringing, Process{"first order", 0.8, 0.0, 0.0}}) {
        int covered = 0;
        int naive = 0;
        int without = 0;
        for (unsigned run = 0; run < 400; ++run) {
            const Line line(process, 600, 100 + run);
            estimator::EstimateOptions options;
            options.verdict = false;
            const auto result = estimator::estimate(line.parameters, {&line.residual}, {}, options);
            const auto& b = result.parameters[1];
            if (b.interval_method == estimator::IntervalMethod::too_few_independent) ++without;
            if (b.lower95 <= 2.0 && 2.0 <= b.upper95) ++covered;
            if (std::abs(b.value - 2.0) <= 1.96 * b.laplace_sd) ++naive;
        }
        CAPTURE(process.name, covered, naive, without);
        CHECK(without <= 4);
        CHECK(covered >= 359);
        CHECK(covered <= 397);
        // Ringing errors cancel (narrower by seven), persistent ones add up (wider by three).
        CHECK((naive >= 399 || naive < 300));
    }
}

TEST_CASE("a drift beneath noise is seen in the scores, not in neighbours", "[estimator]") {
    constexpr Eigen::Index n = 20000;
    Line line({"white", 0.0, 0.0, 0.0}, n, 4);
    const Eigen::VectorXd drift = Process{"drift", 0.998, 0.0, 0.0}.simulated(n, 8);
    const Eigen::VectorXd y = line.x * Eigen::Vector2d(1.0, 2.0) + 0.1 * Process{"", 0.0, 0.0, 0.0}.simulated(n, 4);
    FunctionResidual residual;
    estimator::Group ordered = group("y");
    ordered.ordered = true;
    ordered.interval = 1.0;
    residual.add_group(ordered);
    // Sds 0.1 and 0.01: correlation of neighbours 0.01, variance of a mean eleven times that of independent errors.
    residual.add_block(layout("record", n), linear(y + 0.01 * drift / 15.8, line.x));
    const auto result = estimator::estimate(line.parameters, {&residual});
    CHECK(std::abs(result.scales[0].lag1) < 3.0 / std::sqrt(static_cast<double>(n)));
    CHECK(result.parameters[0].interval_method == estimator::IntervalMethod::sandwich);
    CHECK(result.parameters[0].sd > 2.0 * result.parameters[0].laplace_sd);
    const auto quiet = estimator::estimate(line.parameters, {&line.residual});
    CHECK(quiet.parameters[0].interval_method == estimator::IntervalMethod::t);
}

TEST_CASE("table, profile, marginal and sample agree where intervals are from a sandwich", "[estimator]") {
    const Line line({"first order", 0.8, 0.0, 0.0}, 1500, 21);
    const std::vector<const estimator::Residual*> residuals{&line.residual};
    const auto result = estimator::estimate(line.parameters, residuals);
    const auto profiles = estimator::profiles(line.parameters, residuals, {}, result);
    const auto marginals = estimator::marginals(line.parameters, residuals, {}, result);
    estimator::SampleOptions options;
    options.draws = 1000;
    options.seed = 5;
    const auto sample = estimator::sample_posterior(line.parameters, residuals, {}, {}, result, options);
    CHECK_THAT(sample.message, ContainsSubstring("moved to the covariance of the table"));
    for (std::size_t k = 0; k < 2; ++k) {
        const estimator::Estimated& table = result.parameters[k];
        REQUIRE(table.interval_method == estimator::IntervalMethod::sandwich);
        CHECK(table.sd > 2.0 * table.laplace_sd);
        CHECK(profiles[k].method == "profile sandwich");
        // Exact but for the tolerance of the threshold, 1e-4 of it.
        const double half = 0.5 * (table.upper95 - table.lower95);
        CHECK_THAT(profiles[k].lower, WithinAbs(table.lower95, 1e-3 * half));
        CHECK_THAT(profiles[k].upper, WithinAbs(table.upper95, 1e-3 * half));
        // A t density of 1500 degrees of freedom under a power; the sample in Monte Carlo.
        CHECK_THAT(marginals[k].sd, WithinRel(table.sd, 0.01));
        CHECK_THAT(sample.parameters[k].mean, WithinAbs(table.value, 5.0 * sample.parameters[k].mean_error));
        CHECK_THAT(sample.parameters[k].sd, WithinAbs(table.sd, 5.0 * sample.parameters[k].sd_error));
    }
}

}  // namespace orbid::tests::score_spectrum_test

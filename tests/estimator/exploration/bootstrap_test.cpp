#include "estimator/exploration/bootstrap.hpp"

#include <cmath>
#include <mutex>

#include <tbb/global_control.h>
#include <Eigen/LU>
#include <boost/math/distributions/students_t.hpp>

#include "models/definition/wrong_data.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::bootstrap_test {

using estimator::Bootstrap;
using estimator::BootstrapOptions;
using estimator::BootstrapReplicate;
using estimator::ErrorDraw;
using estimator::Estimate;
using estimator::EstimateStatus;

namespace {

/// A residual, its parameters and its estimate.
struct Fit {
    FunctionResidual residual;
    std::vector<estimator::FreeParameter> parameters;
    estimator::EstimateOptions options;
    Estimate estimate;

    void run() { estimate = estimator::estimate(parameters, {&residual}, {}, options); }
    [[nodiscard]] Bootstrap bootstrap(const BootstrapOptions& asked) const {
        return estimator::bootstrap(parameters, {&residual}, {}, options, estimate, asked);
    }
};

constexpr Eigen::Index line_records = 12;

/// A line through 12 records whose errors have an unknown sd.
struct LineFit : Fit {
    Eigen::MatrixXd design{line_records, 2};

    LineFit() {
        const Eigen::VectorXd x = Eigen::VectorXd::LinSpaced(line_records, -1.0, 2.0);
        design << Eigen::VectorXd::Ones(line_records), x;
        // Errors of no pattern.
        Eigen::VectorXd y{{0.3, -0.9, 0.7, 1.4, -0.2, -1.1, 0.5, 0.9, -1.6, 0.2, 1.0, -0.6}};
        y += design * Eigen::Vector2d(5.0, -3.0);
        residual.add_group(group("e"));
        residual.add_block(layout("line", line_records), linear(y, design));
        parameters = {free_parameter("level", 4.0), free_parameter("slope", -2.0)};
        run();
    }
};

BootstrapOptions options_of(std::size_t replicates, ErrorDraw kind = ErrorDraw::parametric) {
    BootstrapOptions asked;
    asked.replicates = replicates;
    asked.draws.kind = kind;
    return asked;
}

void check_same(const Bootstrap& one, const Bootstrap& other) {
    REQUIRE(one.replicates.size() == other.replicates.size());
    for (std::size_t i = 0; i < one.replicates.size(); ++i) {
        CHECK(one.replicates[i].number == i);
        CHECK(one.replicates[i].values == other.replicates[i].values);
        CHECK(one.replicates[i].sds == other.replicates[i].sds);
    }
    for (std::size_t i = 0; i < one.parameters.size(); ++i) {
        CHECK(one.parameters[i].bias == other.parameters[i].bias);
        CHECK(one.parameters[i].studentised_upper == other.parameters[i].studentised_upper);
    }
}

}  // namespace

TEST_CASE("the bootstrap of a line has its sds, and its studentised interval is that of Student's t",
          "[estimator][bootstrap]") {
    const LineFit fit;
    REQUIRE(fit.estimate.status == EstimateStatus::converged);
    constexpr std::size_t count = 16000;
    const Bootstrap found = fit.bootstrap(options_of(count));
    CHECK(found.failed == 0);
    CHECK(found.refused.empty());
    const double scale = fit.estimate.scales[0].value;
    const Eigen::MatrixXd inverse = (fit.design.transpose() * fit.design).inverse();
    const double t = boost::math::quantile(boost::math::students_t(line_records - 2), 0.975);
    REQUIRE(found.parameters.size() == 2);
    for (Eigen::Index i = 0; i < 2; ++i) {
        const auto& x = found.parameters[static_cast<std::size_t>(i)];
        CAPTURE(x.name);
        const double sd = scale * std::sqrt(inverse(i, i));
        // Monte Carlo errors: sd / sqrt(2 N) = 0.6 %; bias 1 / sqrt(N) = 0.8 % of a sd. Bounds are four of them.
        CHECK_THAT(x.bootstrap_sd, WithinRel(sd, 0.023));
        CHECK(std::abs(x.bias) < 4.0 * x.bias_error);
        CHECK_THAT(x.bias_error, WithinRel(x.bootstrap_sd / std::sqrt(count), 1e-12));
        // A quantile's error is sqrt(p q / N) / density: 1.1 % of 1.96 sds, 1.4 % of t = 2.23.
        CHECK_THAT(x.percentile_upper - x.value, WithinRel(1.96 * sd, 0.045));
        CHECK_THAT(x.value - x.percentile_lower, WithinRel(1.96 * sd, 0.045));
        CHECK_THAT(x.studentised_upper - x.value, WithinRel(t * sd, 0.055));
        CHECK_THAT(x.value - x.studentised_lower, WithinRel(t * sd, 0.055));
    }
    // s*^2 is s^2 chi^2 / dof: the bias of s* is that of chi, -1 / (4 dof) and higher, the sd 1 / sqrt(2 dof).
    REQUIRE(found.errors.size() == 1);
    const double degrees = line_records - 2;
    const double mean = std::sqrt(2.0 / degrees) * std::exp(std::lgamma((degrees + 1) / 2) - std::lgamma(degrees / 2));
    CHECK_THAT(found.errors[0].bias / scale, WithinAbs(mean - 1.0, 0.008));
    CHECK_THAT(found.errors[0].bootstrap_sd / scale, WithinRel(std::sqrt(1.0 - mean * mean), 0.03));
}

TEST_CASE("a bootstrap is the same for any number of threads and after any part of it",
          "[estimator][bootstrap][threads]") {
    const LineFit fit;
    BootstrapOptions asked = options_of(60);
    const Bootstrap expected = fit.bootstrap(asked);
    for (const std::size_t threads : {1, 2, 4}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        check_same(fit.bootstrap(asked), expected);
    }
    // A run that is stopped keeps what it has; the next one computes the rest alone.
    int before_stop = 17;
    std::mutex door;
    std::vector<BootstrapReplicate> kept;
    Fit stopped = fit;
    stopped.options.interrupted = [&] {
        const std::lock_guard lock(door);
        return before_stop <= 0;
    };
    BootstrapOptions first = asked;
    first.keep_seconds = 0.0;
    first.keep = [&](const std::vector<BootstrapReplicate>& done) { kept = done; };
    first.progress = [&](std::size_t, std::size_t) {
        const std::lock_guard lock(door);
        --before_stop;
    };
    const Bootstrap part = stopped.bootstrap(first);
    CHECK(part.replicates.size() == kept.size());
    REQUIRE(kept.size() >= 17);
    REQUIRE(kept.size() < 60);
    CHECK_THAT(part.refused, ContainsSubstring("stopped after"));
    CHECK(std::isnan(part.parameters[0].percentile_lower));
    std::size_t computed = 0;
    BootstrapOptions second = asked;
    second.done = kept;
    second.progress = [&](std::size_t, std::size_t) { ++computed; };
    check_same(fit.bootstrap(second), expected);
    CHECK(computed == 60 - kept.size());
}

TEST_CASE("a normal prior is drawn anew like a record", "[estimator][bootstrap]") {
    Fit fit;
    fit.residual.add_group(group("e", 2.0, false));
    fit.residual.add_block(layout("mean", 4),
                           linear(Eigen::Vector4d(9.0, 11.0, 10.0, 12.0), Eigen::MatrixXd::Ones(4, 1)));
    fit.parameters = {free_parameter("mean", 10.0)};
    fit.parameters[0].prior = estimator::NormalPrior{8.0, 0.5};
    fit.run();
    const Bootstrap found = fit.bootstrap(options_of(4000));
    const auto& x = found.parameters[0];
    // Information 4 / 2^2 of the records and 1 / 0.5^2 of the prior.
    CHECK_THAT(x.sd, WithinRel(1.0 / std::sqrt(5.0), 1e-6));
    CHECK_THAT(x.bootstrap_sd, WithinRel(x.sd, 0.045));
    CHECK(std::abs(x.bias) < 4.0 * x.bias_error);
}

TEST_CASE("correlated residuals are drawn in blocks, and the scatter is that of correlated errors",
          "[estimator][bootstrap]") {
    static constexpr Eigen::Index count = 2000;
    constexpr double rho = 0.8;
    const auto mean_of = [](double correlation, std::uint64_t index) {
        estimator::RandomStream random(2, estimator::RandomPurpose::reading_noise, index);
        Eigen::VectorXd y(count);
        y[0] = random.normal();
        for (Eigen::Index i = 1; i < count; ++i)
            y[i] = correlation * y[i - 1] + std::sqrt(1.0 - correlation * correlation) * random.normal();
        Fit fit;
        estimator::Group errors = group("e");
        errors.ordered = true;
        fit.residual.add_group(errors);
        fit.residual.add_block(layout("mean", count), linear(y, Eigen::MatrixXd::Ones(count, 1)));
        fit.parameters = {free_parameter("mean", 0.0)};
        fit.run();
        return fit;
    };
    // The sd of a mean of an autoregression.
    const double known = std::sqrt((1.0 + rho) / (1.0 - rho) / count);
    constexpr std::uint64_t records = 8;
    double mean_ratio = 0.0;
    for (std::uint64_t i = 0; i < records; ++i) {
        const Bootstrap blocks = mean_of(rho, i).bootstrap(options_of(400, ErrorDraw::automatic));
        CHECK(blocks.kind == ErrorDraw::blocks);
        CHECK(blocks.block > 10);
        mean_ratio += blocks.parameters[0].bootstrap_sd / known / records;
    }
    // Blocks of b = 39 lose G / (b g(0)) = 11 % of the variance and scatter by sqrt(4 b / (3 n)) = 16 % of it: of the
    // sd 6 % and 8 %, over eight records 3 %.
    CHECK_THAT(mean_ratio, WithinAbs(0.94, 0.12));
    const Bootstrap parametric = mean_of(rho, 0).bootstrap(options_of(400, ErrorDraw::parametric));
    CHECK(parametric.parameters[0].bootstrap_sd < 0.5 * known);
    CHECK(mean_of(0.0, 0).bootstrap(options_of(40, ErrorDraw::automatic)).kind == ErrorDraw::parametric);
}

TEST_CASE("failed replicates are counted, and too many of them refuse the intervals", "[estimator][bootstrap]") {
    // y = theta with sd 1, where nothing can be computed beyond a limit.
    const auto failing_beyond = [](double limit) {
        Fit fit;
        fit.residual.add_group(group("e", 1.0, false));
        fit.residual.add_block(layout("one", 1), [limit](const Eigen::VectorXd& theta, const Eigen::VectorXd&, bool) {
            estimator::BlockValue value;
            if (theta[0] > limit) {
                value.status = estimator::BlockStatus::failed;
                return value;
            }
            value.e = Eigen::VectorXd::Constant(1, -theta[0]);
            value.e_theta = Eigen::MatrixXd::Constant(1, 1, -1.0);
            value.e_z.resize(1, 0);
            return value;
        });
        fit.parameters = {free_parameter("theta", -0.5)};
        fit.run();
        return fit;
    };
    const Bootstrap few = failing_beyond(2.5).bootstrap(options_of(500));
    CHECK(few.refused.empty());  // 0.6 % lie beyond 2.5 sds
    CHECK(few.failed < 12);
    const Bootstrap many = failing_beyond(1.0).bootstrap(options_of(500));
    // 15.9 %, sd of the share 1.6 %.
    CHECK(many.failed > 50);
    CHECK(many.failed < 110);
    CHECK_THAT(many.refused, ContainsSubstring("of 500 replicates failed, more than 5 %"));
    std::size_t told = 0;
    for (const auto& failure : many.failures) {
        told += failure.count;
        CHECK_FALSE(failure.message.empty());
    }
    CHECK(told == many.failed);
    CHECK(std::isnan(many.parameters[0].percentile_lower));
    CHECK(std::isnan(many.parameters[0].studentised_upper));
    CHECK(std::isfinite(many.parameters[0].bootstrap_sd));
}

TEST_CASE("fewer replicates than an interval needs are refused", "[estimator][bootstrap]") {
    const LineFit fit;
    CHECK_THROWS_WITH(fit.bootstrap(options_of(38)), ContainsSubstring("replicates = 38 must be 39 or more"));
}

TEST_CASE("new errors have the law that the estimate gives them", "[estimator][bootstrap]") {
    static constexpr Eigen::Index count = 20000;
    const auto drawn = [](const estimator::ErrorDistribution& distribution, double scale) {
        Fit fit;
        estimator::Group errors = group("e", scale, false);
        errors.distribution = distribution;
        fit.residual.add_group(errors);
        estimator::BlockLayout block = layout("b", count);
        block.observed = Eigen::VectorXd::Constant(count, 10.0);
        fit.residual.add_block(block, linear(block.observed, Eigen::MatrixXd::Ones(count, 1)));
        fit.parameters = {free_parameter("level", 10.1)};
        fit.run();
        const estimator::RecordDraws draws({&fit.residual}, fit.estimate, {ErrorDraw::parametric, 4, false});
        // y* - yhat
        return Eigen::VectorXd(draws.shifts(3)[0][0] + fit.estimate.residuals[0][0].e);
    };
    const auto share_beyond = [](const Eigen::VectorXd& errors, double size) {
        return static_cast<double>((errors.array().abs() > size).count()) / count;
    };
    // Shares of a half have a sd of 0.0035.
    const Eigen::VectorXd normal = drawn(estimator::NormalErrors{}, 2.0);
    CHECK_THAT(share_beyond(normal, 2.0 * 0.6745), WithinAbs(0.5, 0.015));
    // Quartile of t with 4 degrees of freedom: 0.7407.
    estimator::StudentErrors student;
    student.dof = {false, 4.0, estimator::FlatPrior{}};
    const Eigen::VectorXd heavy = drawn(student, 2.0);
    CHECK_THAT(share_beyond(heavy, 2.0 * 0.7407), WithinAbs(0.5, 0.015));
    CHECK_THAT(share_beyond(heavy, 2.0 * 2.7764), WithinAbs(0.05, 0.007));
    CHECK_THAT(share_beyond(drawn(estimator::LaplaceErrors{}, 2.0), 2.0 * std::log(2.0)), WithinAbs(0.5, 0.015));
    estimator::RelativeErrors relative;
    relative.relative = {false, 0.1, estimator::FlatPrior{}};
    CHECK_THAT(share_beyond(drawn(relative, 1.0), std::sqrt(2.0) * 0.6745), WithinAbs(0.5, 0.02));
    const Eigen::VectorXd logarithmic = drawn(estimator::LogNormalErrors{}, 0.5);
    const Eigen::VectorXd ln = ((logarithmic.array() + 10.0) / 10.0).log();
    CHECK_THAT(ln.mean(), WithinAbs(0.0, 0.015));
    CHECK_THAT(std::sqrt(ln.squaredNorm() / count), WithinRel(0.5, 0.02));
    estimator::AutoregressiveErrors chain;
    chain.correlation = {false, 0.7, estimator::FlatPrior{}};
    const Eigen::VectorXd course = drawn(chain, 2.0);
    const double square = course.squaredNorm() / count;
    CHECK_THAT(std::sqrt(square), WithinRel(2.0, 0.06));
    CHECK_THAT(course.head(count - 1).dot(course.tail(count - 1)) / count / square, WithinAbs(0.7, 0.02));
}

TEST_CASE("links that are a slack of the computation have no errors in new records", "[estimator][bootstrap]") {
    // z' = theta z, read with sd 0.1; links have a fixed sd of 0.01.
    constexpr std::size_t nodes = 12;
    FunctionChain chain;
    chain.add_group(group("reading", 0.1, false));
    chain.add_group(group("matching", 0.01, false));
    for (std::size_t b = 0; b < nodes; ++b) {
        const bool last = b + 1 == nodes;
        estimator::BlockLayout block = layout("node", last ? 1 : 2);
        if (!last) block.group[1] = 1;
        block.latents = 1;
        block.linked_from = last ? -1 : 1;
        block.next = last ? -1 : static_cast<std::ptrdiff_t>(b) + 1;
        const double y = 2.0 * std::pow(0.9, b) + (b % 3 == 0 ? 0.1 : -0.05);
        chain.add_block(
            block,
            [y, last](const Eigen::VectorXd& theta, const Eigen::VectorXd& z, const Eigen::VectorXd& next) {
                estimator::BlockValue value;
                const Eigen::Index records = last ? 1 : 2;
                value.e = Eigen::VectorXd::Constant(records, y - z[0]);
                value.e_theta = Eigen::MatrixXd::Zero(records, 1);
                value.e_z = Eigen::MatrixXd::Constant(records, 1, -1.0);
                if (last) return value;
                value.e[1] = next[0] - theta[0] * z[0];
                value.e_theta(1, 0) = -z[0];
                value.e_z(1, 0) = -theta[0];
                value.e_next = Eigen::MatrixXd::Zero(2, 1);
                value.e_next(1, 0) = 1.0;
                return value;
            },
            Eigen::VectorXd::Constant(1, y));
    }
    const std::vector<estimator::FreeParameter> parameters{free_parameter("theta", 0.8)};
    const Estimate estimate = estimator::estimate(parameters, {&chain});
    REQUIRE(estimate.status == EstimateStatus::converged);
    const auto link_errors = [&](bool fixed_links_err) {
        const estimator::RecordDraws draws({&chain}, estimate, {ErrorDraw::parametric, 1, fixed_links_err});
        double squares = 0.0;
        for (std::size_t n = 0; n < 100; ++n) {
            const auto shifts = draws.shifts(n);
            for (std::size_t b = 0; b + 1 < nodes; ++b) {
                const double error = shifts[0][b][1] + estimate.residuals[0][b].e[1];
                squares += error * error / (100.0 * (nodes - 1));
            }
        }
        return std::sqrt(squares);
    };
    CHECK(link_errors(false) == 0.0);
    CHECK_THAT(link_errors(true), WithinRel(0.01, 0.1));
    // Blocks where nodes have taken up errors of the readings.
    CHECK_THROWS_AS(estimator::RecordDraws({&chain}, estimate, {ErrorDraw::blocks, 1, true}), models::DataError);

    // Without errors of links, y_k = z_0 theta^k: the information about theta with z_0 unknown.
    const double theta = estimate.parameters[0].value;
    const double first = estimate.latents[0][0][0];
    Eigen::MatrixXd slopes(nodes, 2);
    for (Eigen::Index k = 0; k < slopes.rows(); ++k)
        slopes.row(k) << first * static_cast<double>(k) * std::pow(theta, k - 1), std::pow(theta, k);
    const double known = 0.1 * std::sqrt(Eigen::MatrixXd((slopes.transpose() * slopes).inverse())(0, 0));
    const auto found = estimator::bootstrap(parameters, {&chain}, {}, {}, estimate, options_of(1000));
    // Links let the estimate use less of the readings; it is nonlinear. Monte Carlo error 2.2 %.
    CHECK_THAT(found.parameters[0].bootstrap_sd, WithinRel(known, 0.12));
}

}  // namespace orbid::tests::bootstrap_test

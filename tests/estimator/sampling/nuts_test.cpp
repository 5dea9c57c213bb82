#include "estimator/sampling/nuts.hpp"

#include <oneapi/tbb/global_control.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "estimator/sampling/chain_diagnostic.hpp"
#include "estimator/sampling/unbounded_coordinate.hpp"
#include "tests/catch.hpp"

namespace orbid::tests::nuts_test {

namespace {

using estimator::NegativeLogDensity;
using estimator::NutsOptions;
using estimator::PhasePoint;

constexpr double infinity = std::numeric_limits<double>::infinity();

/// x_1 ~ N(0, 4), x_2 = (x_1^2 - 4) / 2 + N(0, 1): means 0, variances 4 and 2 (1/2)^2 4^2 + 1 = 9.
double banana(const Eigen::VectorXd& x, Eigen::VectorXd* gradient) {
    const double bend = x[1] - 0.5 * (x[0] * x[0] - 4.0);
    if (gradient != nullptr) {
        (*gradient)[0] = x[0] / 4.0 - bend * x[0];
        (*gradient)[1] = bend;
    }
    return x[0] * x[0] / 8.0 + 0.5 * bend * bend;
}

double standard_normal(const Eigen::VectorXd& x, Eigen::VectorXd* gradient) {
    if (gradient != nullptr) *gradient = x;
    return 0.5 * x.squaredNorm();
}

PhasePoint phase_point(const NegativeLogDensity& density, Eigen::VectorXd x, Eigen::VectorXd r) {
    PhasePoint point;
    point.x = std::move(x);
    point.r = std::move(r);
    estimator::evaluate(density, point);
    return point;
}

/// f of all draws, shape (draws, chains).
template <class F>
Eigen::MatrixXd seen(const estimator::NutsResult& result, const F& f) {
    const Eigen::Index draws = result.chains.front().draws.cols();
    Eigen::MatrixXd values(draws, static_cast<Eigen::Index>(result.chains.size()));
    for (Eigen::Index c = 0; c < values.cols(); ++c)
        for (Eigen::Index i = 0; i < draws; ++i)
            values(i, c) = f(Eigen::VectorXd(result.chains[static_cast<std::size_t>(c)].draws.col(i)));
    return values;
}

/// Distance of the sample mean from the truth in Monte-Carlo standard errors.
double errors_off(const Eigen::MatrixXd& values, double truth) {
    return (values.mean() - truth) / estimator::mean_standard_error(values);
}

NutsOptions with_seed(std::uint64_t seed) {
    NutsOptions options;
    options.seed = seed;
    return options;
}

// 5 standard errors: chance 6e-7 each, some 150 comparisons below, so that a sound sampler fails once in 1e4 runs of
// the whole file. Seeds are consecutive, none was chosen. The seeds of a moment together, root-mean-square, catch a
// bias of about one standard error.
void judge(const std::vector<double>& off) {
    double square = 0.0;
    for (const double z : off) {
        CHECK(std::abs(z) < 5.0);
        square += z * z;
    }
    // chi-square of n = 4 seeds: above 2.7^2 n with probability 1e-5.
    CHECK(std::sqrt(square / static_cast<double>(off.size())) < 2.7);
}

}  // namespace

TEST_CASE("leapfrog steps of the harmonic oscillator have their closed form", "[estimator]") {
    // x_n = cos(n w) x_0 with cos w = 1 - h^2 / 2, started at rest.
    const double h = 0.3;
    const Eigen::MatrixXd unit = Eigen::MatrixXd::Identity(1, 1);
    PhasePoint point = phase_point(standard_normal, Eigen::VectorXd::Constant(1, 2.0), Eigen::VectorXd::Zero(1));
    const double w = std::acos(1.0 - 0.5 * h * h);
    for (int n = 1; n <= 100; ++n) {
        estimator::leapfrog(standard_normal, unit, h, point);
        // Rounding of 100 steps, measured 4e-14; the bound is ten times that.
        REQUIRE_THAT(point.x[0], WithinAbs(2.0 * std::cos(n * w), 4e-13));
    }
    // With the metric 1 / 4 of a density whose sd is 1 / 2 the same numbers come out, halved.
    const NegativeLogDensity narrow = [](const Eigen::VectorXd& x, Eigen::VectorXd* gradient) {
        *gradient = 4.0 * x;
        return 2.0 * x.squaredNorm();
    };
    PhasePoint half = phase_point(narrow, Eigen::VectorXd::Constant(1, 1.0), Eigen::VectorXd::Zero(1));
    for (int n = 1; n <= 100; ++n)
        estimator::leapfrog(narrow, 0.5 * unit, h, half);
    CHECK(half.x[0] == 0.5 * point.x[0]);
}

TEST_CASE("leapfrog is reversible, keeps volume and loses energy in second order", "[estimator]") {
    Eigen::MatrixXd factor(2, 2);
    factor << 1.5, 0.0, -0.4, 0.8;
    const PhasePoint start = phase_point(banana, Eigen::Vector2d(1.0, -0.5), Eigen::Vector2d(0.7, -1.1));
    PhasePoint point = start;
    for (int n = 0; n < 100; ++n)
        estimator::leapfrog(banana, factor, 0.05, point);
    CHECK((point.x - start.x).norm() > 0.1);
    for (int n = 0; n < 100; ++n)
        estimator::leapfrog(banana, factor, -0.05, point);
    // Rounding, amplified by the stretching of neighbours: measured 2e-15, the bound is ten times that.
    CHECK((point.x - start.x).norm() + (point.r - start.r).norm() < 2e-14);

    std::vector<double> error;
    for (int n = 20; n <= 320; n *= 2) {
        point = start;
        for (int i = 0; i < n; ++i)
            estimator::leapfrog(banana, factor, 2.0 / n, point);
        error.push_back(std::abs(point.energy() - start.energy()));
    }
    for (std::size_t i = 1; i + 1 < error.size(); ++i) {
        CAPTURE(i, error[i], error[i + 1]);
        // Measured 1.98, 1.995, 1.999 from the second halving on.
        CHECK_THAT(std::log2(error[i] / error[i + 1]), WithinAbs(2.0, 0.1));
    }

    // Determinant of the Jacobian of one long step, by central differences of step 1e-5: error about 1e-10.
    Eigen::MatrixXd jacobian(4, 4);
    const auto flow = [&](const Eigen::Vector4d& s) {
        PhasePoint moved = phase_point(banana, s.head(2), s.tail(2));
        estimator::leapfrog(banana, factor, 0.3, moved);
        Eigen::Vector4d end;
        end << moved.x, moved.r;
        return end;
    };
    Eigen::Vector4d s;
    s << start.x, start.r;
    for (Eigen::Index i = 0; i < 4; ++i)
        jacobian.col(i) =
            (flow(s + 1e-5 * Eigen::Vector4d::Unit(i)) - flow(s - 1e-5 * Eigen::Vector4d::Unit(i))) / 2e-5;
    CHECK_THAT(jacobian.determinant(), WithinAbs(1.0, 1e-8));
}

TEST_CASE("a correlated normal in ten dimensions, from a right and from a wrong metric", "[estimator]") {
    constexpr int d = 10;
    Eigen::MatrixXd covariance(d, d);
    for (int i = 0; i < d; ++i)
        for (int j = 0; j < d; ++j)
            covariance(i, j) = std::pow(0.9, std::abs(i - j)) * (1.0 + i) * (1.0 + j);
    const Eigen::MatrixXd precision = covariance.inverse();
    const NegativeLogDensity density = [&](const Eigen::VectorXd& x, Eigen::VectorXd* gradient) {
        // Loops: tests are not optimised, and Eigen's expressions are slow then.
        double value = 0.0;
        for (Eigen::Index i = 0; i < d; ++i) {
            const double* row = precision.data() + d * i;
            double sum = 0.0;
            for (Eigen::Index j = 0; j < d; ++j)
                sum += row[j] * x.data()[j];
            gradient->data()[i] = sum;
            value += 0.5 * sum * x.data()[i];
        }
        return value;
    };
    const Eigen::VectorXd mean = Eigen::VectorXd::Zero(d);
    std::vector<std::vector<double>> off(2 * d + 1);
    for (std::uint64_t seed = 1; seed <= 4; ++seed) {
        CAPTURE(seed);
        const Eigen::MatrixXd metric = seed % 2 == 0 ? covariance : Eigen::MatrixXd(Eigen::MatrixXd::Identity(d, d));
        const auto result = estimator::sample(density, mean, metric, with_seed(seed));
        REQUIRE(result.chains.size() == 4);
        for (const auto& chain : result.chains) {
            CHECK(chain.draws.cols() == 1000);
            CHECK(chain.divergences == 0);
            CHECK(chain.saturated == 0);
            // The target was 0.8; the averaged step is on the safe side of it, as known from other programs.
            CHECK(chain.acceptance > 0.75);
            CHECK(chain.acceptance < 0.97);
            // Known metric: trajectories of 7 steps at most 15.
            CHECK(chain.evaluations < 15 * 1000);
        }
        for (Eigen::Index i = 0; i < d; ++i) {
            const auto at = static_cast<std::size_t>(i);
            off[2 * at].push_back(errors_off(seen(result, [&](const Eigen::VectorXd& x) { return x[i]; }), 0.0));
            off[2 * at + 1].push_back(
                errors_off(seen(result, [&](const Eigen::VectorXd& x) { return x[i] * x[i]; }), covariance(i, i)));
        }
        off.back().push_back(
            errors_off(seen(result, [](const Eigen::VectorXd& x) { return x[0] * x[9]; }), covariance(0, 9)));
        // The potential is half a chi-square of ten degrees of freedom: mean 5.
        double potential = 0.0;
        for (const auto& chain : result.chains)
            potential += chain.potential.mean() / 4.0;
        // sd sqrt(5), some 1000 effective draws at least: 5 standard errors are 0.35.
        CHECK_THAT(potential, WithinAbs(5.0, 0.35));
    }
    for (const auto& moments : off)
        judge(moments);
}

TEST_CASE("a banana with known moments", "[estimator]") {
    std::vector<std::vector<double>> off(5);
    for (std::uint64_t seed = 11; seed <= 14; ++seed) {
        const auto result = estimator::sample(banana, Eigen::Vector2d(0.0, -2.0),
                                              Eigen::Vector2d(4.0, 1.0).asDiagonal(), with_seed(seed));
        const auto moment = [&](auto f, double truth) { return errors_off(seen(result, f), truth); };
        off[0].push_back(moment([](const Eigen::VectorXd& x) { return x[0]; }, 0.0));
        off[1].push_back(moment([](const Eigen::VectorXd& x) { return x[1]; }, 0.0));
        off[2].push_back(moment([](const Eigen::VectorXd& x) { return x[0] * x[0]; }, 4.0));
        off[3].push_back(moment([](const Eigen::VectorXd& x) { return x[1] * x[1]; }, 9.0));
        off[4].push_back(moment([](const Eigen::VectorXd& x) { return x[0] * x[1]; }, 0.0));
    }
    for (const auto& moments : off)
        judge(moments);
}

TEST_CASE("a half normal through a bound, and a wall that cannot be passed", "[estimator]") {
    const estimator::UnboundedCoordinate above{0.0, infinity};
    const NegativeLogDensity bounded = [&](const Eigen::VectorXd& v, Eigen::VectorXd* gradient) {
        const double x = above.bounded(v[0]);
        (*gradient)[0] = x * above.slope(v[0]) - above.ln_slope_first(v[0]);
        return 0.5 * x * x - above.ln_slope(v[0]);
    };
    const NegativeLogDensity wall = [](const Eigen::VectorXd& x, Eigen::VectorXd* gradient) {
        (*gradient)[0] = x[0];
        return x[0] >= 0.0 ? 0.5 * x[0] * x[0] : infinity;
    };
    const double mean = std::sqrt(2.0 / std::numbers::pi);
    std::vector<std::vector<double>> off(4);
    for (std::uint64_t seed = 21; seed <= 24; ++seed) {
        const Eigen::MatrixXd unit = Eigen::MatrixXd::Identity(1, 1);
        const auto free = estimator::sample(bounded, Eigen::VectorXd::Zero(1), unit, with_seed(seed));
        const auto x = [&](const Eigen::VectorXd& v) { return above.bounded(v[0]); };
        off[0].push_back(errors_off(seen(free, x), mean));
        off[1].push_back(errors_off(seen(free, x).array().square().matrix(), 1.0));
        const auto walled = estimator::sample(wall, Eigen::VectorXd::Ones(1), unit, with_seed(seed));
        const auto y = [](const Eigen::VectorXd& v) { return v[0]; };
        off[2].push_back(errors_off(seen(walled, y), mean));
        off[3].push_back(errors_off(seen(walled, y).array().square().matrix(), 1.0));
        for (const auto& chain : walled.chains)
            CHECK(chain.divergences > 0);
        for (const auto& chain : free.chains)
            CHECK(chain.divergences == 0);
    }
    for (const auto& moments : off)
        judge(moments);
}

TEST_CASE("the tails of Student's t", "[estimator]") {
    // Five degrees of freedom, from tables: P(|x| > 2.570581836) = 0.05 and P(|x| > 0.726686844) = 0.5.
    const NegativeLogDensity student = [](const Eigen::VectorXd& x, Eigen::VectorXd* gradient) {
        double value = 0.0;
        for (Eigen::Index i = 0; i < x.size(); ++i) {
            value += 3.0 * std::log1p(x[i] * x[i] / 5.0);
            (*gradient)[i] = 6.0 * x[i] / (5.0 + x[i] * x[i]);
        }
        return value;
    };
    std::vector<std::vector<double>> off(4);
    for (std::uint64_t seed = 31; seed <= 34; ++seed) {
        const auto result =
            estimator::sample(student, Eigen::VectorXd::Zero(2), Eigen::MatrixXd::Identity(2, 2), with_seed(seed));
        const auto share = [&](Eigen::Index i, double bound, double truth) {
            return errors_off(
                seen(result, [&](const Eigen::VectorXd& x) { return std::abs(x[i]) > bound ? 1.0 : 0.0; }), truth);
        };
        off[0].push_back(share(0, 2.570581836, 0.05));
        off[1].push_back(share(1, 2.570581836, 0.05));
        off[2].push_back(share(0, 0.726686844, 0.5));
        off[3].push_back(share(1, 0.726686844, 0.5));
    }
    for (const auto& moments : off)
        judge(moments);
}

TEST_CASE("the same draws with any number of threads, others with another seed", "[estimator][threads]") {
    NutsOptions options;
    options.draws = 50;
    options.warm_up = 60;
    const auto run = [&](std::size_t threads) {
        const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism, threads);
        return estimator::sample(banana, Eigen::Vector2d(0.0, -2.0), Eigen::Matrix2d::Identity(), options);
    };
    const auto one = run(1);
    for (const std::size_t threads : {2, 4}) {
        const auto many = run(threads);
        for (std::size_t c = 0; c < 4; ++c) {
            CHECK(many.chains[c].draws == one.chains[c].draws);
            CHECK(many.chains[c].metric == one.chains[c].metric);
            CHECK(many.chains[c].step == one.chains[c].step);
        }
    }
    for (std::size_t c = 1; c < 4; ++c)
        CHECK(one.chains[c].draws != one.chains[0].draws);
    options.seed = 2;
    CHECK(run(4).chains[0].draws != one.chains[0].draws);
    // Fewer chains are the first ones.
    options.seed = 1;
    options.chains = 2;
    CHECK(run(4).chains[1].draws == one.chains[1].draws);
}

TEST_CASE("sampling tells how far it is and stops when asked", "[estimator]") {
    NutsOptions options;
    options.warm_up = 30;
    options.draws = 40;
    int last = 0;
    int total = 0;
    options.progress = [&](int done, int of) {
        CHECK(done == last + 1);
        last = done;
        total = of;
    };
    const auto start = Eigen::Vector2d(0.0, -2.0);
    const auto whole = estimator::sample(banana, start, Eigen::Matrix2d::Identity(), options);
    CHECK_FALSE(whole.interrupted);
    CHECK(last == 280);
    CHECK(total == 280);
    for (const int limit : {1, 100, 200}) {
        CAPTURE(limit);
        last = 0;
        options.interrupted = [&] { return last >= limit; };
        const auto part = estimator::sample(banana, start, Eigen::Matrix2d::Identity(), options);
        CHECK(part.interrupted);
        // Every chain ends at its next look.
        CHECK(last <= limit + 4);
        for (std::size_t c = 0; c < 4; ++c) {
            const Eigen::MatrixXd& draws = part.chains[c].draws;
            CHECK(draws.cols() <= 40);
            CHECK(draws == whole.chains[c].draws.leftCols(draws.cols()));
            CHECK(part.chains[c].potential.size() == draws.cols());
        }
    }
}

TEST_CASE("long trajectories are ended and counted", "[estimator]") {
    NutsOptions options;
    options.maximum_depth = 2;
    options.warm_up = 19;  // a step, but no metric
    options.acceptance = 0.95;
    options.draws = 100;
    options.chains = 1;
    // A direction a hundred times as long as the metric says takes hundreds of steps.
    const NegativeLogDensity density = [](const Eigen::VectorXd& x, Eigen::VectorXd* gradient) {
        *gradient = Eigen::Vector2d(x[0], 1e-4 * x[1]);
        return 0.5 * (x[0] * x[0] + 1e-4 * x[1] * x[1]);
    };
    const auto result = estimator::sample(density, Eigen::VectorXd::Zero(2), Eigen::MatrixXd::Identity(2, 2), options);
    CHECK(result.chains[0].saturated > 50);
    CHECK(result.chains[0].evaluations <= 300);
}

TEST_CASE("wrong calls of the sampler are refused", "[estimator]") {
    const auto refused = [](const NutsOptions& options, const std::string& word) {
        CHECK_THROWS_WITH(
            estimator::sample(standard_normal, Eigen::VectorXd::Zero(2), Eigen::MatrixXd::Identity(2, 2), options),
            ContainsSubstring(word));
    };
    const auto with = [](auto change) {
        NutsOptions options;
        change(options);
        return options;
    };
    const double nan = std::numeric_limits<double>::quiet_NaN();
    refused(with([](NutsOptions& o) { o.chains = 0; }), "chains = 0");
    refused(with([](NutsOptions& o) { o.warm_up = -1; }), "warm_up = -1");
    refused(with([](NutsOptions& o) { o.draws = 0; }), "draws = 0");
    refused(with([](NutsOptions& o) { o.acceptance = 1.0; }), "acceptance");
    refused(with([&](NutsOptions& o) { o.acceptance = nan; }), "acceptance");
    refused(with([](NutsOptions& o) { o.maximum_depth = 0; }), "maximum_depth = 0");
    refused(with([](NutsOptions& o) { o.maximum_depth = 21; }), "maximum_depth = 21");
    refused(with([&](NutsOptions& o) { o.spread = nan; }), "spread");

    const auto call = [](const NegativeLogDensity& density, Eigen::Index dimension, const Eigen::MatrixXd& metric) {
        return estimator::sample(density, Eigen::VectorXd::Zero(dimension), metric);
    };
    CHECK_THROWS_WITH(call(standard_normal, 0, Eigen::MatrixXd(0, 0)), ContainsSubstring("nothing to sample"));
    CHECK_THROWS_WITH(call(standard_normal, 2, Eigen::MatrixXd::Identity(3, 3)), ContainsSubstring("shape (2, 2)"));
    CHECK_THROWS_WITH(call(standard_normal, 2, -Eigen::MatrixXd::Identity(2, 2)),
                      ContainsSubstring("positive definite"));
    CHECK_THROWS_WITH(
        call([](const Eigen::VectorXd&, Eigen::VectorXd*) { return infinity; }, 2, Eigen::MatrixXd::Identity(2, 2)),
        ContainsSubstring("cannot be evaluated"));
    // A value without a gradient is no value.
    CHECK_THROWS_WITH(call(
                          [&](const Eigen::VectorXd& x, Eigen::VectorXd* gradient) {
                              gradient->setConstant(x.size(), nan);
                              return 0.0;
                          },
                          2, Eigen::MatrixXd::Identity(2, 2)),
                      ContainsSubstring("cannot be evaluated"));
}

}  // namespace orbid::tests::nuts_test

#include <cmath>
#include <random>

#include <Eigen/Cholesky>
#include <Eigen/QR>

#include "estimator/algebra/subspace.hpp"
#include "estimator/estimate/estimate.hpp"
#include "estimator/uncertainty/identifiability.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::identifiability_test {

namespace {

/// y = (k2 / m) t + (k3 / m) t^2 + noise: m, k2, k3 enter only as k_i / m.
/// Derivatives carry relative noise, as those of integrated equations do.
FunctionResidual ratios(double noise, double derivative_noise = 0.0) {
    std::mt19937_64 generator(7);
    std::normal_distribution<double> normal;
    const Eigen::Index n = 40;
    Eigen::VectorXd t(n);
    Eigen::VectorXd y(n);
    for (Eigen::Index i = 0; i < n; ++i) {
        t[i] = 0.1 * static_cast<double>(i + 1);
        y[i] = 2.0 * t[i] + 3.0 * t[i] * t[i] + noise * normal(generator);
    }
    FunctionResidual residual;
    residual.add_group(group("y"));
    residual.add_block(layout("data", n),
                       [t, y, derivative_noise](const Eigen::VectorXd& p, const Eigen::VectorXd&, bool) {
                           estimator::BlockValue value;
                           const Eigen::VectorXd t2 = t.cwiseAbs2();
                           value.e = y - (p[1] * t + p[2] * t2) / p[0];
                           value.e_theta.resize(y.size(), 3);
                           value.e_theta << (p[1] * t + p[2] * t2) / (p[0] * p[0]), -t / p[0], -t2 / p[0];
                           std::mt19937_64 noisy(11);
                           std::normal_distribution<double> unit;
                           for (double& entry : value.e_theta.reshaped())
                               entry *= 1.0 + derivative_noise * unit(noisy);
                           value.e_z.resize(y.size(), 0);
                           return value;
                       });
    return residual;
}

std::vector<estimator::FreeParameter> m_k2_k3(estimator::Scale scale) {
    std::vector<estimator::FreeParameter> parameters{free_parameter("m", 0.5), free_parameter("k2", 0.7),
                                                     free_parameter("k3", 2.0)};
    for (auto& parameter : parameters)
        parameter.scale = scale;
    return parameters;
}

}  // namespace

TEST_CASE("parameters that enter only as ratios: singular, the direction found numerically", "[estimator]") {
    for (const auto scale : {estimator::Scale::linear, estimator::Scale::log}) {
        for (const double noise : {0.0, 1e-6, 0.1}) {
            FunctionResidual residual = ratios(noise);
            estimator::DerivedQuantity ratio{
                "k2_over_m", [](const Eigen::VectorXd& p) { return p[1] / p[0]; },
                [](const Eigen::VectorXd& p) {
                    return Eigen::VectorXd(Eigen::Vector3d(-p[1] / (p[0] * p[0]), 1.0 / p[0], 0.0));
                }};
            auto parameters = m_k2_k3(scale);
            for (auto& parameter : parameters)
                parameter.typical_size = 0.1;
            const auto result = estimator::estimate(parameters, {&residual}, {ratio});
            CAPTURE(static_cast<int>(scale), noise, result.message);
            CHECK(result.status == estimator::EstimateStatus::singular);
            REQUIRE(result.null_directions.size() == 1);
            for (Eigen::Index i = 0; i < 3; ++i)
                CHECK_THAT(result.null_directions[0].components[i], WithinAbs(1.0, 1e-9));
            CHECK_THAT(result.message,
                       ContainsSubstring(
                           "m, k2 and k3 enter only in a combination: m +1, k2 +1, k3 +1 leaves the data unchanged"));
            for (const auto& parameter : result.parameters) {
                CHECK(std::isnan(parameter.sd));
                CHECK(std::isfinite(parameter.value));
            }
            // The combination is determined all the same: t slope 2 within five of its own sds, which are finite.
            CHECK(std::isfinite(result.derived[0].sd));
            CHECK(std::abs(result.derived[0].value - 2.0) <= 5.0 * result.derived[0].sd + 1e-12);
            // Did not wander: the parameters stay within a factor of ten of the start.
            CHECK(result.parameters[0].value > 0.05);
            CHECK(result.parameters[0].value < 5.0);
        }
    }
}

TEST_CASE("of ratios the quotients are told, also on linear scales", "[estimator]") {
    FunctionResidual residual = ratios(0.1);
    const auto result = estimator::estimate(
        {free_parameter("m", 1.5), free_parameter("k2", 2.0), free_parameter("k3", 3.0)}, {&residual});
    REQUIRE(result.null_directions.size() == 1);
    // Which of the three the others are divided by is the largest component's affair: all are 1.
    const std::string& told = result.null_directions[0].told;
    CAPTURE(told);
    CHECK((told == "k2 / m and k3 / m" || told == "m / k2 and k3 / k2" || told == "m / k3 and k2 / k3"));
}

TEST_CASE("what the data tell of an undetermined direction is written as the reader would", "[estimator]") {
    std::vector<estimator::FreeParameter> log{free_parameter("m", 1.0), free_parameter("k2", 1.0),
                                              free_parameter("k3", 1.0)};
    for (auto& parameter : log)
        parameter.scale = estimator::Scale::log;
    const Eigen::Vector3d ones = Eigen::Vector3d::Ones();
    CHECK(estimator::what_is_told(ones, log, ones) == "k2 / m and k3 / m");
    CHECK(estimator::what_is_told(Eigen::Vector3d(0.0, 1.0, -1.0), log, ones) == "k3 k2");
    CHECK(estimator::what_is_told(Eigen::Vector3d(1.0, 0.5, 1e-4), log, ones) == "k2 / m^(1/2)");
    CHECK(estimator::what_is_told(Eigen::Vector3d(1.0, 0.0, 0.0), log, ones).empty());
    // k2 + 0.8 k3 stays where k2 falls by 0.8 of what k3 rises; sizes turn relative changes into these.
    const std::vector<estimator::FreeParameter> linear{free_parameter("m", 1.0), free_parameter("k2", 1.0),
                                                       free_parameter("k3", 1.0)};
    CHECK(estimator::what_is_told(Eigen::Vector3d(0.0, -0.4, 1.0), linear, Eigen::Vector3d(1.0, 2.0, 1.0)) ==
          "k2 + 0.8 k3");
}

TEST_CASE("noise of the derivatives does not hide a null direction", "[estimator]") {
    for (const double derivative_noise : {1e-11, 1e-9}) {
        FunctionResidual residual = ratios(1e-6, derivative_noise);
        const auto result = estimator::estimate(m_k2_k3(estimator::Scale::log), {&residual});
        CAPTURE(derivative_noise, result.message);
        CHECK(result.status == estimator::EstimateStatus::singular);
        REQUIRE(result.null_directions.size() == 1);
        // Equal weights of 40 rows: the direction is wrong by the order of the noise.
        for (Eigen::Index i = 0; i < 3; ++i)
            CHECK_THAT(result.null_directions[0].components[i], WithinAbs(1.0, 100.0 * derivative_noise));
    }
}

TEST_CASE("a proper prior on one of them decides the combination, and the result says so", "[estimator]") {
    for (const auto scale : {estimator::Scale::linear, estimator::Scale::log}) {
        FunctionResidual residual = ratios(1e-6);
        auto parameters = m_k2_k3(scale);
        parameters[0].prior = estimator::NormalPrior{0.4, 0.02};
        const auto result = estimator::estimate(parameters, {&residual});
        CAPTURE(static_cast<int>(scale), result.message);
        REQUIRE(result.status == estimator::EstimateStatus::converged);
        CHECK_THAT(result.message, ContainsSubstring("the prior alone decides"));
        if (scale == estimator::Scale::linear) {
            CHECK_THAT(result.parameters[0].value, WithinRel(0.4, 1e-6));
            CHECK_THAT(result.parameters[0].sd, WithinRel(0.02, 1e-6));
        } else {
            // Mode in ln m of a normal density of m: (m - 0.4) m / sd^2 = 1.
            const double mode = 0.5 * (0.4 + std::sqrt(0.16 + 4.0 * 0.0004));
            CHECK_THAT(result.parameters[0].value, WithinRel(mode, 1e-6));
        }
        for (const auto& parameter : result.parameters)
            CHECK(parameter.data_share == 0.0);
        CHECK_THAT(result.correlation(0, 1), WithinAbs(1.0, 1e-6));
    }
}

TEST_CASE("a start on a bound can leave it, an active bound is named", "[estimator]") {
    // y = a + b t with b >= 0; the data slope is positive, then negative.
    for (const double slope : {1.0, -1.0}) {
        Eigen::VectorXd t = Eigen::VectorXd::LinSpaced(9, 0.0, 1.0);
        Eigen::MatrixXd x(9, 3);
        x << Eigen::VectorXd::Ones(9), t, t.cwiseAbs2();
        Eigen::VectorXd y = 1.0 + slope * t.array() + 0.5 * t.array().square();
        for (Eigen::Index i = 0; i < 9; ++i)
            y[i] += i % 2 == 0 ? 0.01 : -0.01;
        FunctionResidual residual;
        residual.add_group(group("y"));
        residual.add_block(layout("data", 9), linear(y, x));
        std::vector<estimator::FreeParameter> parameters{free_parameter("a", 0.0), free_parameter("b", 0.0),
                                                         free_parameter("c", 0.0)};
        parameters[1].lower = 0.0;
        parameters[2].lower = 0.0;
        const auto result = estimator::estimate(parameters, {&residual});
        CAPTURE(slope, result.message);
        REQUIRE(result.status == estimator::EstimateStatus::converged);
        if (slope > 0.0) {
            const Eigen::Vector3d expected = (x.transpose() * x).ldlt().solve(x.transpose() * y);
            for (Eigen::Index i = 0; i < 3; ++i)
                CHECK_THAT(result.parameters[static_cast<std::size_t>(i)].value, WithinRel(expected[i], 1e-10));
        } else {
            CHECK(result.parameters[1].value == 0.0);
            CHECK(result.parameters[1].at_bound == estimator::BoundSide::lower);
            CHECK(std::isnan(result.parameters[1].sd));
            CHECK_THAT(result.message, ContainsSubstring("b is at its lower bound"));
            CHECK(std::isfinite(result.parameters[0].sd));
        }
    }
}

TEST_CASE("noise-free data from a gross misfit: the scale falls to its floor, nothing is infinite", "[estimator]") {
    FunctionResidual residual = ratios(0.0);
    auto parameters = m_k2_k3(estimator::Scale::log);
    parameters.erase(parameters.begin());
    FunctionResidual two;
    two.add_group(group("y", 1.0));
    two.add_block(residual.layout()[0], [&residual](const Eigen::VectorXd& p, const Eigen::VectorXd&, bool) {
        auto value =
            residual.evaluate(residual.initial_set(), Eigen::Vector3d(1.0, p[0], p[1]), {Eigen::VectorXd()}, true)[0];
        value.e_theta = value.e_theta.rightCols(2).eval();
        return value;
    });
    const auto result = estimator::estimate(parameters, {&two});
    CAPTURE(result.message, result.scales[0].value);
    REQUIRE(result.status == estimator::EstimateStatus::converged);
    CHECK_THAT(result.parameters[0].value, WithinRel(2.0, 1e-13));
    CHECK_THAT(result.parameters[1].value, WithinRel(3.0, 1e-13));
    CHECK(result.scales[0].value > 0.0);
    CHECK(result.scales[0].value < 1e-13);
    CHECK(std::isfinite(result.objective));
}

namespace {

/// What identifiability() says of whitened sensitivities with the given singular values and right singular vectors
/// (columns; completed to an orthonormal basis) in units of `size`.
estimator::Identifiability seen(const Eigen::VectorXd& values, const Eigen::MatrixXd& directions,
                                const Eigen::VectorXd& size) {
    const Eigen::Index q = size.size();
    const Eigen::MatrixXd v = directions.householderQr().householderQ();
    // The QR keeps the span of the first columns; the sign of a direction does not matter.
    const Eigen::MatrixXd relative = values.asDiagonal() * v.transpose();
    const Eigen::MatrixXd r = relative * size.cwiseInverse().asDiagonal();
    estimator::BoundedStep step;
    for (Eigen::Index i = 0; i < q; ++i)
        step.free.push_back(i);
    step.space = estimator::split(r, Eigen::MatrixXd::Zero(0, q), size, 3e-8);
    return estimator::identifiability(r, step, size, size);
}

std::vector<estimator::FreeParameter> named_m_k2_k3() {
    return m_k2_k3(estimator::Scale::log);
}

}  // namespace

TEST_CASE("a sloppy direction is a product of powers", "[estimator]") {
    const auto parameters = named_m_k2_k3();
    const Eigen::Vector3d size(1.0, 1e-3, 50.0);
    const auto check = [&](const Eigen::Vector3d& direction, const Eigen::Vector3d& values,
                           const Eigen::Vector3d& expected, const std::string& product) {
        const auto result = seen(values, direction, size);
        CAPTURE(product);
        CHECK(result.null_directions.empty());
        REQUIRE(result.sloppy_directions.size() == 1);
        const auto& sloppy = result.sloppy_directions[0];
        for (Eigen::Index i = 0; i < 3; ++i)
            CHECK_THAT(sloppy.components[i], WithinAbs(expected[i], 1e-9));
        CHECK(estimator::as_product(sloppy.components, parameters) == product);
        // The logarithm of the product along the direction itself: |components| / singular value, and a rounded
        // direction costs the data a tenth more at most.
        CHECK_THAT(sloppy.sd, WithinRel(sloppy.components.norm() / values[0], 0.1));
    };
    const Eigen::Vector3d sharp(0.4, 1000.0, 500.0);
    check({1.0, 1.0, 1.0}, sharp, {1.0, 1.0, 1.0}, "m^1 k2^1 k3^1");
    check({1.0, -1.0, 0.0}, sharp, {1.0, -1.0, 0.0}, "m^1 k2^-1");
    check({0.5, 1.0, -1.0 / 3.0}, sharp, {0.5, 1.0, -1.0 / 3.0}, "m^(1/2) k2^1 k3^(-1/3)");
    // The data know the direction to 0.4 / 1000: 0.52 is not one half, although near.
    check({1.0, 0.52, 0.0}, sharp, {1.0, 0.52, 0.0}, "m^1 k2^0.52");
    // Here they know it to some percent: 0.98 is as good as one, 0.02 as good as nothing.
    check({1.0, 0.98, 0.02}, {0.4, 8.0, 6.0}, {1.0, 1.0, 0.0}, "m^1 k2^1");
    CHECK(estimator::in_words(estimator::SloppyDirection{Eigen::Vector3d(1.0, 1.0, 0.0), 2.5}, parameters) ==
          "the data know m^1 k2^1 only within a factor 12.2 (sd of its logarithm 2.5)");
    CHECK(estimator::in_words(estimator::SloppyDirection{Eigen::Vector3d(0.0, 1.0, 0.0), 120.0}, parameters) ==
          "the data know k2^1 only within a factor e^120");
}

TEST_CASE("no direction is sloppy when all are well known, or none", "[estimator]") {
    const Eigen::Vector3d size = Eigen::Vector3d::Ones();
    const Eigen::Vector3d direction(1.0, 1.0, 1.0);
    CHECK(seen(Eigen::Vector3d(1.5, 1000.0, 900.0), direction, size).sloppy_directions.empty());
    CHECK(seen(Eigen::Vector3d(0.2, 0.9, 1.1), direction, size).sloppy_directions.empty());
    // Two of them, the least determined first.
    const auto two = seen(Eigen::Vector3d(0.2, 0.5, 100.0), Eigen::Matrix3d::Identity(), size).sloppy_directions;
    REQUIRE(two.size() == 2);
    CHECK_THAT(two[0].sd, WithinRel(5.0, 1e-12));
    CHECK_THAT(two[1].sd, WithinRel(2.0, 1e-12));
    CHECK(two[0].components == Eigen::Vector3d::UnitX());
    CHECK(two[1].components == Eigen::Vector3d::UnitY());
}

TEST_CASE("a sloppy direction beside a null direction", "[estimator]") {
    Eigen::MatrixXd directions(3, 2);
    directions << 1.0, 1.0, 1.0, -1.0, 0.0, 0.0;
    const auto result = seen(Eigen::Vector3d(0.0, 0.25, 1e4), directions, Eigen::Vector3d(2.0, 3.0, 1e-5));
    REQUIRE(result.null_directions.size() == 1);
    CHECK_THAT(result.null_directions[0].components[1], WithinAbs(1.0, 1e-9));
    REQUIRE(result.sloppy_directions.size() == 1);
    CHECK(estimator::as_product(result.sloppy_directions[0].components, named_m_k2_k3()) == "m^1 k2^-1");
    CHECK_THAT(result.sloppy_directions[0].sd, WithinRel(std::sqrt(2.0) / 0.25, 1e-9));
}

}  // namespace orbid::tests::identifiability_test

#include "estimator/exploration/profile.hpp"

#include <cmath>
#include <limits>

#include <tbb/global_control.h>
#include <Eigen/LU>
#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/students_t.hpp>

#include "models/definition/wrong_data.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::profile_test {

namespace {

using estimator::Profile;
using estimator::ProfileEnd;

struct Regression {
    Eigen::MatrixXd x;
    Eigen::VectorXd y;
};

Regression made_regression() {
    Regression data{Eigen::MatrixXd(9, 2), Eigen::VectorXd(9)};
    data.y << 1.1, 0.7, 0.9, 0.2, 0.1, -0.4, -0.1, -0.9, -0.8;
    for (Eigen::Index i = 0; i < 9; ++i)
        data.x.row(i) << 1.0, static_cast<double>(i) / 8.0;
    return data;
}

// Biochemical oxygen demand, Marske 1967, as in Bates and Watts (1988), table A1.4: y = a (1 - exp(-k t)).
FunctionResidual demand() {
    FunctionResidual residual;
    residual.add_group(group("demand"));
    residual.add_block(layout("data", 6), [](const Eigen::VectorXd& theta, const Eigen::VectorXd&, bool) {
        const Eigen::ArrayXd t = (Eigen::ArrayXd(6) << 1.0, 2.0, 3.0, 4.0, 5.0, 7.0).finished();
        const Eigen::ArrayXd y = (Eigen::ArrayXd(6) << 8.3, 10.3, 19.0, 16.0, 15.6, 19.8).finished();
        const Eigen::ArrayXd decay = (-theta[1] * t).exp();
        estimator::BlockValue value;
        value.e = y - theta[0] * (1.0 - decay);
        value.e_theta.resize(6, 2);
        value.e_theta.col(0) = decay - 1.0;
        value.e_theta.col(1) = -theta[0] * t * decay;
        value.e_z.resize(6, 0);
        return value;
    });
    return residual;
}

std::vector<estimator::FreeParameter> demand_parameters() {
    std::vector<estimator::FreeParameter> parameters{free_parameter("a", 15.0), free_parameter("k", 0.4)};
    for (auto& parameter : parameters) {
        parameter.scale = estimator::Scale::log;
        parameter.lower = 0.0;
    }
    return parameters;
}

}  // namespace

TEST_CASE("profiles of a linear regression are its t intervals and the scale's own likelihood", "[estimator]") {
    const Regression data = made_regression();
    FunctionResidual residual;
    residual.add_group(group("y"));
    residual.add_block(layout("data", 9), linear(data.y, data.x));
    const std::vector<estimator::FreeParameter> parameters{free_parameter("a", 0.0), free_parameter("b", 0.0)};
    const auto estimate = estimator::estimate(parameters, {&residual});
    const auto result = estimator::profiles(parameters, {&residual}, {}, estimate);
    REQUIRE(result.size() == 3);
    const Eigen::MatrixXd inverse = (data.x.transpose() * data.x).inverse();
    const Eigen::VectorXd theta = inverse * data.x.transpose() * data.y;
    const double rest = (data.y - data.x * theta).squaredNorm();
    const boost::math::students_t_distribution<double> student(7.0);
    const double t = boost::math::quantile(student, 0.975);
    for (Eigen::Index j = 0; j < 2; ++j) {
        const Profile& profile = result[static_cast<std::size_t>(j)];
        CAPTURE(profile.name, profile.message);
        REQUIRE(profile.known);
        CHECK(profile.method == "profile t");
        CHECK_THAT(profile.threshold, WithinRel(9.0 * std::log1p(t * t / 7.0), 1e-12));
        const double sd = std::sqrt(rest / 7.0 * inverse(j, j));
        // 1e-4 of the threshold is 5e-5 of its root, here nearly that of t.
        CHECK_THAT(profile.value, WithinAbs(theta[j], 2e-6 * sd));
        CHECK_THAT(profile.lower, WithinAbs(theta[j] - t * sd, 3e-4 * sd));
        CHECK_THAT(profile.upper, WithinAbs(theta[j] + t * sd, 3e-4 * sd));
        CHECK(profile.lower_end == ProfileEnd::found);
        CHECK(profile.failed.empty());
        CHECK(profile.improvement == 0.0);
        CHECK(profile.points.size() >= 9);
        CHECK(profile.points.size() <= 25);
        for (const estimator::ProfilePoint& point : profile.points) {
            // 2 (Phi - min) = n ln(1 + d^2 / (n - q)), d = distance in sds.
            const double d = (point.value - profile.value) / sd;
            CHECK_THAT(point.signed_root, WithinAbs(std::copysign(std::sqrt(9.0 * std::log1p(d * d / 7.0)), d), 1e-5));
        }
    }
    // n (2 ln(s / s0) + s0^2 / s^2 - 1) = chi-squared quantile, s0^2 = rest / n.
    const Profile& scale = result[2];
    CHECK(scale.name == "y.scale");
    CHECK(scale.method == "profile chi2");
    CHECK_THAT(scale.value, WithinRel(std::sqrt(rest / 9.0), 1e-6));
    const double quantile = boost::math::quantile(boost::math::chi_squared_distribution<double>(1.0), 0.95);
    for (const double s : {scale.lower, scale.upper}) {
        const double ratio = rest / 9.0 / (s * s);
        CHECK_THAT(9.0 * (ratio - std::log(ratio) - 1.0), WithinRel(quantile, 1.1e-4));
    }
}

TEST_CASE("profiles with a known scale and with a prior are normal", "[estimator]") {
    const Regression data = made_regression();
    FunctionResidual residual;
    residual.add_group(group("y", 0.3, false));
    residual.add_block(layout("data", 9), linear(data.y, data.x));
    std::vector<estimator::FreeParameter> parameters{free_parameter("a", 0.0), free_parameter("b", 0.0)};
    parameters[0].prior = estimator::NormalPrior{0.5, 0.2};
    const auto estimate = estimator::estimate(parameters, {&residual});
    estimator::ProfileOptions options;
    options.level = 0.8;
    const auto result = estimator::profiles(parameters, {&residual}, {}, estimate, options);
    REQUIRE(result.size() == 2);
    Eigen::Matrix2d information = data.x.transpose() * data.x / 0.09;
    information(0, 0) += 25.0;
    const Eigen::Matrix2d c = information.inverse();
    const Eigen::Vector2d theta = c * (data.x.transpose() * data.y / 0.09 + Eigen::Vector2d(12.5, 0.0));
    const double root = std::sqrt(boost::math::quantile(boost::math::chi_squared_distribution<double>(1.0), 0.8));
    for (Eigen::Index j = 0; j < 2; ++j) {
        const Profile& profile = result[static_cast<std::size_t>(j)];
        const double sd = std::sqrt(c(j, j));
        CHECK(profile.method == "profile chi2");
        CHECK_THAT(profile.lower, WithinAbs(theta[j] - root * sd, 1e-4 * sd));
        CHECK_THAT(profile.upper, WithinAbs(theta[j] + root * sd, 1e-4 * sd));
    }
}

TEST_CASE("profiles of the oxygen demand data agree with R", "[estimator][reference]") {
    FunctionResidual residual = demand();
    const auto parameters = demand_parameters();
    const auto estimate = estimator::estimate(parameters, {&residual});
    REQUIRE(estimate.status == estimator::EstimateStatus::converged);
    const auto result = estimator::profiles(parameters, {&residual}, {}, estimate);
    // R 4.2.2: uniroot of S(theta) = S_min (1 + t^2 / (n - q)), the other parameter by its closed form (k) or optimize
    // (a), tolerance 1e-14. The ends are found to 1e-4 of the threshold: here below 1e-4 of themselves.
    CHECK_THAT(result[0].value, WithinRel(19.14257528, 1e-5));
    CHECK_THAT(result[0].lower, WithinRel(14.04936416, 1e-4));
    CHECK_THAT(result[0].upper, WithinRel(38.45619797, 2e-4));
    CHECK_THAT(result[1].value, WithinRel(0.531091377, 1e-5));
    CHECK_THAT(result[1].lower, WithinRel(0.1313977467, 2e-4));
    CHECK_THAT(result[1].upper, WithinRel(1.808169595, 2e-4));
    CHECK(result[0].method == "profile t");
    // The same from one thread: bytes, not digits.
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    const auto single = estimator::profiles(parameters, {&residual}, {}, estimate);
    for (std::size_t k = 0; k < result.size(); ++k) {
        CHECK(single[k].lower == result[k].lower);
        CHECK(single[k].upper == result[k].upper);
        CHECK(single[k].points.size() == result[k].points.size());
    }
}

TEST_CASE("a profile that never reaches the threshold is open", "[estimator]") {
    // k -> infinity leaves a constant, S = 107.2; 99 % allow S up to 163.7.
    FunctionResidual residual = demand();
    const auto parameters = demand_parameters();
    const auto estimate = estimator::estimate(parameters, {&residual});
    estimator::ProfileOptions options;
    options.level = 0.99;
    options.names = {"k"};
    const auto result = estimator::profiles(parameters, {&residual}, {}, estimate, options);
    REQUIRE(result.size() == 1);
    CHECK(result[0].upper_end == ProfileEnd::open);
    CHECK(result[0].upper == std::numeric_limits<double>::infinity());
    CHECK(name(result[0].upper_end) == "open");
}

TEST_CASE("profiles end at bounds and at points that fail", "[estimator]") {
    const Regression data = made_regression();
    const auto plain = linear(data.y, data.x);
    FunctionResidual residual;
    residual.add_group(group("y", 0.3, false));
    // Cannot be evaluated above a = 1.15.
    residual.add_block(layout("data", 9), [plain](const Eigen::VectorXd& theta, const Eigen::VectorXd& z, bool all) {
        estimator::BlockValue value = plain(theta, z, all);
        if (theta[0] > 1.15) value.status = estimator::BlockStatus::failed;
        return value;
    });
    std::vector<estimator::FreeParameter> parameters{free_parameter("a", 0.0), free_parameter("b", -0.5)};
    parameters[1].upper = -1.9;
    parameters[1].start = -2.1;
    const auto estimate = estimator::estimate(parameters, {&residual});
    REQUIRE(estimate.status == estimator::EstimateStatus::converged);
    const auto result = estimator::profiles(parameters, {&residual}, {}, estimate);
    const Profile& a = result[0];
    CHECK(a.upper_end == ProfileEnd::failed);
    CHECK(a.upper <= 1.15);
    // Bisected six times from a step of two sds (0.1 each).
    CHECK(a.upper > 1.13);
    REQUIRE_FALSE(a.failed.empty());
    CHECK(a.failed.front() > 1.15);
    CHECK(result[1].upper_end == ProfileEnd::bound);
    CHECK(result[1].upper == -1.9);
    CHECK(residual.layout()[0].active);
}

TEST_CASE("profiles refuse what makes no sense, and say when they are interrupted", "[estimator]") {
    const Regression data = made_regression();
    FunctionResidual residual;
    residual.add_group(group("y"));
    residual.add_block(layout("data", 9), linear(data.y, data.x));
    const std::vector<estimator::FreeParameter> parameters{free_parameter("a", 0.9), free_parameter("b", 0.0)};
    const auto estimate = estimator::estimate(parameters, {&residual});
    const auto refuses = [&](auto change) {
        estimator::ProfileOptions options;
        change(options);
        CHECK_THROWS_AS(estimator::profiles(parameters, {&residual}, {}, estimate, options), std::invalid_argument);
    };
    refuses([](auto& options) { options.level = 1.0; });
    refuses([](auto& options) { options.tolerance = 0.0; });
    refuses([](auto& options) { options.reach = std::nan(""); });
    refuses([](auto& options) { options.curve_points = -1; });
    refuses([](auto& options) { options.maximum_points = 0; });
    estimator::ProfileOptions unknown;
    unknown.names = {"c"};
    CHECK_THROWS_AS(estimator::profiles(parameters, {&residual}, {}, estimate, unknown), models::DataError);
    estimator::EstimateOptions options;
    options.interrupted = [] { return true; };
    const auto stopped = estimator::profiles(parameters, {&residual}, options, estimate);
    CHECK_FALSE(stopped[0].known);
    CHECK(stopped[0].upper_end == ProfileEnd::interrupted);
}

}  // namespace orbid::tests::profile_test

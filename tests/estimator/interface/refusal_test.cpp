// Input that makes no sense, and data that cannot answer: refused by name, or an outcome that says why.

#include <cmath>
#include <functional>
#include <limits>
#include <string>

#include "estimator/estimate/estimate.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::refusal_test {

namespace {

constexpr double nan_value = std::numeric_limits<double>::quiet_NaN();
constexpr double infinity = std::numeric_limits<double>::infinity();

/// y = 1 + 2 x with a wiggle, n records.
FunctionResidual line(Eigen::Index n, const estimator::Group& of, double wiggle = 0.1) {
    Eigen::MatrixXd x(n, 2);
    x << Eigen::VectorXd::Ones(n), Eigen::VectorXd::LinSpaced(n, 0.0, n > 1 ? 1.0 : 0.0);
    const Eigen::VectorXd y = x * Eigen::Vector2d(1.0, 2.0) + wiggle * (17.0 * x.col(1).array()).sin().matrix();
    FunctionResidual residual;
    residual.add_group(of);
    residual.add_block(layout("line", n), linear(y, x));
    return residual;
}

std::vector<estimator::FreeParameter> two() {
    return {free_parameter("a", 0.0), free_parameter("b", 0.0)};
}

std::string refusal(const std::function<void()>& call) {
    try {
        call();
    } catch (const std::invalid_argument& error) {
        return error.what();
    }
    return "";
}

/// What estimate() says of one block with one record changed by `change`.
std::string refusal_of(const std::function<void(estimator::BlockLayout&)>& change, estimator::Group of = group("y")) {
    FunctionResidual residual;
    residual.add_group(std::move(of));
    auto block = layout("run 7", 3);
    change(block);
    residual.add_block(block, linear(Eigen::Vector3d(1.0, 2.0, 4.0), Eigen::MatrixXd::Ones(3, 1)));
    return refusal([&] { (void)estimator::estimate({free_parameter("theta", 0.0)}, {&residual}); });
}

}  // namespace

TEST_CASE("fewer records than parameters: singular with a known scale, failed with an unknown one", "[estimator]") {
    FunctionResidual known = line(1, group("y", 0.1, false));
    const auto singular = estimator::estimate(two(), {&known});
    CAPTURE(singular.message);
    CHECK(singular.status == estimator::EstimateStatus::singular);
    // One record at x = 0 says a and nothing of b.
    REQUIRE(singular.null_directions.size() == 1);
    CHECK(std::abs(singular.null_directions[0].components[1]) == 1.0);
    CHECK_THAT(singular.message, ContainsSubstring("b"));
    CHECK_THAT(singular.parameters[0].value, WithinAbs(1.0, 1e-9));
    CHECK_THAT(singular.parameters[0].sd, WithinRel(0.1, 1e-9));
    CHECK(std::isnan(singular.parameters[1].sd));
    CHECK(singular.parameters[1].value == 0.0);

    FunctionResidual unknown = line(1, group("y"));
    const auto failed = estimator::estimate(two(), {&unknown});
    CHECK(failed.status == estimator::EstimateStatus::failed);
    CHECK_THAT(failed.message, ContainsSubstring("1 records cannot determine 1 parameters"));
    FunctionResidual none;
    none.add_group(group("y"));
    const auto empty = estimator::estimate(two(), {&none});
    CHECK(empty.status == estimator::EstimateStatus::failed);
    CHECK_THAT(empty.message, ContainsSubstring("no residual record"));
}

TEST_CASE("known sds and covariance shapes that make no sense are refused with their block", "[estimator]") {
    using Layout = estimator::BlockLayout;
    const auto deviations = [](const Eigen::VectorXd& value) {
        return refusal_of([&](Layout& block) { block.deviation = value; });
    };
    CHECK(deviations(Eigen::Vector3d(1.0, 2.0, 3.0)).empty());
    for (const double wrong : {0.0, -1.0, nan_value, infinity}) {
        const std::string message = deviations(Eigen::Vector3d(1.0, wrong, 1.0));
        CAPTURE(wrong);
        CHECK_THAT(message, ContainsSubstring("run 7"));
        CHECK_THAT(message, ContainsSubstring("known sds must be positive and finite"));
    }
    CHECK_THAT(deviations(Eigen::VectorXd::Ones(2)), ContainsSubstring("one for each of the 3 records"));
    CHECK_THAT(refusal_of([](Layout& block) {
                   block.deviation = Eigen::VectorXd::Ones(3);
                   block.shape = Eigen::MatrixXd::Identity(3, 3);
               }),
               ContainsSubstring("both known sds and a covariance shape"));
    const auto shapes = [](const Eigen::MatrixXd& value) {
        return refusal_of([&](Layout& block) { block.shape = value; });
    };
    CHECK(shapes(Eigen::MatrixXd::Identity(3, 3)).empty());
    CHECK_THAT(shapes(Eigen::MatrixXd::Identity(2, 2)), ContainsSubstring("must be 3 x 3"));
    CHECK_THAT(shapes(Eigen::MatrixXd::Ones(3, 3)), ContainsSubstring("positive definite"));
    CHECK_THAT(shapes(nan_value * Eigen::MatrixXd::Identity(3, 3)), ContainsSubstring("positive definite"));
    Eigen::MatrixXd skew = Eigen::MatrixXd::Identity(3, 3);
    skew(0, 2) = 0.5;
    CHECK_THAT(shapes(skew), ContainsSubstring("symmetric"));
    CHECK_THAT(refusal_of([](Layout& block) { block.group[1] = 1; }), ContainsSubstring("group 1 does not exist"));
    CHECK_THAT(refusal_of([](Layout& block) { block.group[1] = -1; }), ContainsSubstring("group -1 does not exist"));
}

TEST_CASE("log-normal and relative errors need the observed value", "[estimator]") {
    auto log_normal = group("y");
    log_normal.distribution = estimator::LogNormalErrors{};
    auto relative = group("y");
    relative.distribution = estimator::RelativeErrors{};
    const auto observed = [](const Eigen::VectorXd& value) {
        return [value](estimator::BlockLayout& block) { block.observed = value; };
    };
    for (const auto& of : {log_normal, relative}) {
        CHECK_THAT(refusal_of([](estimator::BlockLayout&) {}, of), ContainsSubstring("need the observed value"));
        CHECK_THAT(refusal_of(observed(Eigen::Vector2d(1.0, 2.0)), of), ContainsSubstring("need the observed value"));
        CHECK_THAT(refusal_of(observed(Eigen::Vector3d(1.0, nan_value, 1.0)), of), ContainsSubstring("record 1"));
        CHECK_THAT(refusal_of(
                       [](estimator::BlockLayout& block) {
                           block.observed = Eigen::Vector3d(1.0, 2.0, 4.0);
                           block.deviation = Eigen::VectorXd::Ones(3);
                       },
                       of),
                   ContainsSubstring("do not go with"));
    }
    CHECK_THAT(refusal_of(observed(Eigen::Vector3d(1.0, 2.0, 0.0)), log_normal), ContainsSubstring("record 2"));
    CHECK_THAT(refusal_of(observed(Eigen::Vector3d(-1.0, 2.0, 4.0)), log_normal),
               ContainsSubstring("positive for log-normal"));
}

TEST_CASE("a prediction that is not positive shortens the step under log-normal errors", "[estimator]") {
    // yhat = 1 + theta x; the observed values fall fast, so that the first step from theta = 5 aims below -1.
    const Eigen::VectorXd x = Eigen::VectorXd::LinSpaced(9, 0.2, 1.0);
    Eigen::VectorXd y = (1.0 - 0.98 * x.array()).matrix();
    for (Eigen::Index i = 0; i < y.size(); ++i)
        y[i] *= i % 2 == 0 ? 1.1 : 0.9;
    auto of = group("y");
    of.distribution = estimator::LogNormalErrors{};
    const auto residual_with = [&](double offset) {
        FunctionResidual residual;
        residual.add_group(of);
        auto block = layout("falling", y.size());
        block.observed = y;
        residual.add_block(block, linear(y - Eigen::VectorXd::Constant(y.size(), offset), x));
        return residual;
    };
    FunctionResidual residual = residual_with(1.0);
    const auto result = estimator::estimate({free_parameter("theta", 5.0)}, {&residual});
    CAPTURE(result.message);
    CHECK(result.status == estimator::EstimateStatus::converged);
    bool failed = false;
    for (const auto& step : result.history)
        failed = failed || step.reason == estimator::StepRejection::block_failed;
    CHECK(failed);
    // The zero of d/dtheta sum ln^2(y / (1 + theta x)), by bisection.
    double low = -0.999;
    double high = 0.0;
    for (int i = 0; i < 100; ++i) {
        const double theta = 0.5 * (low + high);
        const Eigen::ArrayXd predicted = 1.0 + theta * x.array();
        const double slope = ((y.array() / predicted).log() * x.array() / predicted).sum();
        (slope > 0.0 ? low : high) = theta;
    }
    CHECK_THAT(result.parameters[0].value, WithinAbs(low, 1e-6 * result.parameters[0].sd));
    // At a start where the prediction is negative nothing can be said.
    FunctionResidual again = residual_with(1.0);
    const auto start = estimator::estimate({free_parameter("theta", -3.0)}, {&again});
    CHECK(start.status == estimator::EstimateStatus::failed);
    CHECK_THAT(start.message, ContainsSubstring("falling"));
}

TEST_CASE("bounds and priors that exclude each other, starts outside", "[estimator]") {
    FunctionResidual residual = line(5, group("y"));
    const auto refused = [&](const std::function<void(estimator::FreeParameter&)>& change) {
        auto parameters = two();
        change(parameters[1]);
        return refusal([&] { (void)estimator::estimate(parameters, {&residual}); });
    };
    using Parameter = estimator::FreeParameter;
    const auto bounded = [](Parameter& parameter, double lower, double upper, double start) {
        parameter.lower = lower;
        parameter.upper = upper;
        parameter.start = start;
    };
    CHECK(refused([&](Parameter& b) { bounded(b, 0.0, 3.0, 1.0); }).empty());
    // A single value holds the parameter.
    CHECK(refused([&](Parameter& b) { bounded(b, 1.0, 1.0, 1.0); }).empty());
    CHECK_THAT(refused([&](Parameter& b) { bounded(b, 1.0, 1.0, 2.0); }), ContainsSubstring("\"b\""));
    for (const auto& [lower, upper] : {std::pair{2.0, 1.0}, {nan_value, 1.0}, {0.0, nan_value}}) {
        const std::string message =
            refused([&, lower = lower, upper = upper](Parameter& b) { bounded(b, lower, upper, 1.0); });
        CAPTURE(lower, upper);
        CHECK_THAT(message, ContainsSubstring("\"b\""));
        CHECK_THAT(message, ContainsSubstring("lower one must be below"));
    }
    CHECK_THAT(refused([&](Parameter& b) { bounded(b, 2.0, 3.0, 1.0); }), ContainsSubstring("outside its bounds"));
    CHECK_THAT(refused([&](Parameter& b) { bounded(b, -infinity, 3.0, 3.5); }),
               ContainsSubstring("outside its bounds"));
    CHECK_THAT(refused([&](Parameter& b) {
                   b.prior = estimator::UniformPrior{1.0, 2.0};
               }),
               ContainsSubstring("outside the support"));
    CHECK_THAT(refused([&](Parameter& b) {
                   bounded(b, -2.0, -1.0, -1.5);
                   b.prior = estimator::HalfNormalPrior{1.0};
               }),
               ContainsSubstring("\"b\""));
    CHECK_THAT(refused([&](Parameter& b) {
                   bounded(b, -1.0, 0.0, 0.0);
                   b.prior = estimator::HalfNormalPrior{1.0};
               }),
               ContainsSubstring("exclude each other"));
    CHECK_THAT(refused([&](Parameter& b) {
                   b.scale = estimator::Scale::logit;
                   b.start = 0.5;
                   b.lower = 0.0;
               }),
               ContainsSubstring("finite bounds"));
    CHECK_THAT(refused([&](Parameter& b) { b.typical_size = 0.0; }), ContainsSubstring("typical_size"));
}

TEST_CASE("joint priors that make no sense are refused", "[estimator]") {
    FunctionResidual residual = line(5, group("y"));
    const auto refused = [&](std::vector<estimator::JointNormalPrior> priors,
                             estimator::Prior own = estimator::FlatPrior{}) {
        estimator::EstimateOptions options;
        options.joint_priors = std::move(priors);
        auto parameters = two();
        parameters[0].prior = own;
        return refusal([&] { (void)estimator::estimate(parameters, {&residual}, {}, options); });
    };
    const Eigen::Vector2d mean(1.0, 2.0);
    const Eigen::Matrix2d unit = Eigen::Matrix2d::Identity();
    CHECK(refused({{{"a", "b"}, mean, unit}}).empty());
    CHECK_THAT(refused({{{"a", "b"}, mean, Eigen::Matrix2d::Ones()}}), ContainsSubstring("positive definite"));
    CHECK_THAT(refused({{{"a", "c"}, mean, unit}}), ContainsSubstring("\"c\" is not an estimated parameter"));
    CHECK_THAT(refused({{{"a", "b"}, mean, unit}}, estimator::NormalPrior{0.0, 1.0}),
               ContainsSubstring("prior of its own"));
    const Eigen::VectorXd one = Eigen::VectorXd::Ones(1);
    const Eigen::MatrixXd single = Eigen::MatrixXd::Ones(1, 1);
    CHECK_THAT(refused({{{"a", "b"}, mean, unit}, {{"a"}, one, single}}), ContainsSubstring("two joint priors"));
}

TEST_CASE("names are given once", "[estimator]") {
    FunctionResidual residual = line(5, group("y"));
    residual.add_group(group("y"));
    CHECK_THAT(refusal([&] { (void)estimator::estimate(two(), {&residual}); }),
               ContainsSubstring("group \"y\": the name is given twice"));
    FunctionResidual first = line(5, group("y"));
    FunctionResidual second = line(5, group("y"));
    CHECK_THAT(refusal([&] {
                   (void)estimator::estimate(two(), {&first, &second});
               }),
               ContainsSubstring("group \"y\": the name is given twice"));
    estimator::DerivedQuantity sum{
        "sum", [](const Eigen::VectorXd& theta) { return theta.sum(); },
        [](const Eigen::VectorXd& theta) -> Eigen::VectorXd { return Eigen::VectorXd::Ones(theta.size()); }};
    const auto derived = [&](std::vector<estimator::DerivedQuantity> quantities) {
        return refusal([&] { (void)estimator::estimate(two(), {&first}, quantities); });
    };
    CHECK(derived({sum}).empty());
    CHECK_THAT(derived({sum, sum}), ContainsSubstring("\"sum\" is given twice"));
    auto named = sum;
    named.name = "b";
    CHECK_THAT(derived({named}), ContainsSubstring("\"b\" is given twice"));
    named = sum;
    named.gradient = {};
    CHECK_THAT(derived({named}), ContainsSubstring("needs a value and a gradient"));
}

TEST_CASE("nan from a residual: at the start it names the block, later it shortens the step", "[estimator]") {
    // Gauss-Newton steps of ln(theta) from above end below the minimum exp(-0.7) = 0.497: not a number there.
    int undefined = 0;
    const auto logarithm = [&undefined](bool in_derivative) {
        return [in_derivative, &undefined](const Eigen::VectorXd& theta, const Eigen::VectorXd&, bool) {
            estimator::BlockValue value;
            if (!(theta[0] > 0.49)) ++undefined;
            const Eigen::VectorXd y = Eigen::Vector3d(-0.6, -0.7, -0.8);
            const double guarded = in_derivative || theta[0] > 0.49 ? std::abs(theta[0]) : nan_value;
            value.e = (y.array() - std::log(guarded)).matrix();
            value.e_theta = Eigen::MatrixXd::Constant(3, 1, theta[0] > 0.49 ? -1.0 / theta[0] : nan_value);
            value.e_z.resize(3, 0);
            return value;
        };
    };
    for (const bool in_derivative : {false, true}) {
        CAPTURE(in_derivative);
        undefined = 0;
        FunctionResidual residual;
        residual.add_group(group("y"));
        residual.add_block(layout("log", 3), logarithm(in_derivative));
        const auto result = estimator::estimate({free_parameter("theta", 1.3)}, {&residual});
        CAPTURE(result.message);
        CHECK(result.status == estimator::EstimateStatus::converged);
        CHECK_THAT(result.parameters[0].value, WithinRel(std::exp(-0.7), 1e-6));
        CHECK(undefined > 0);
        CHECK(result.counts[0].used == 1);
        CHECK(result.counts[0].lost == 0);
        const auto start = estimator::estimate({free_parameter("theta", -1.0)}, {&residual});
        CHECK(start.status == estimator::EstimateStatus::failed);
        CHECK_THAT(start.message, ContainsSubstring("cannot be evaluated at the start"));
        CHECK_THAT(start.message, ContainsSubstring("\"log\""));
        CHECK(std::isnan(start.parameters[0].sd));
    }
}

TEST_CASE("an exact fit holds the scale at its floor and says so", "[estimator]") {
    for (const auto variance :
         {estimator::Variance::ml, estimator::Variance::restricted, estimator::Variance::integrated}) {
        CAPTURE(static_cast<int>(variance));
        FunctionResidual residual = line(8, group("y"), 0.0);
        estimator::EstimateOptions options;
        options.variance = variance;
        const auto result = estimator::estimate(two(), {&residual}, {}, options);
        CAPTURE(result.message);
        CHECK(result.status == estimator::EstimateStatus::converged);
        CHECK_THAT(result.message, ContainsSubstring("residuals of y are at rounding level"));
        CHECK(result.scales[0].value > 0.0);
        CHECK(result.scales[0].value < 1e-14);
        for (std::size_t i = 0; i < 2; ++i) {
            CHECK_THAT(result.parameters[i].value, WithinAbs(1.0 + static_cast<double>(i), 1e-13));
            CHECK(std::isfinite(result.parameters[i].sd));
            CHECK(result.parameters[i].sd > 0.0);
            CHECK(std::isfinite(result.parameters[i].lower95));
            CHECK(std::isfinite(result.parameters[i].upper95));
        }
        CHECK(result.covariance.allFinite());
        CHECK(result.correlation.allFinite());
        CHECK(std::isfinite(result.objective));
        CHECK(std::isfinite(result.log_likelihood));
        CHECK(std::isfinite(result.log_integral));
        CHECK(std::isfinite(result.scales[0].rms));
    }
}

TEST_CASE("a group without records disturbs nothing and is not estimated", "[estimator]") {
    FunctionResidual plain = line(8, group("y"));
    constexpr double rounding = 1e-12;  // 8 records, condition 4: some 1e-15, another path of steps may end elsewhere
    for (int law = 0; law < 5; ++law) {
        CAPTURE(law);
        auto idle = group("idle");
        idle.unit = "m";
        if (law == 1) idle.distribution = estimator::StudentErrors{{true, 4.0, estimator::FlatPrior{}}};
        if (law == 2) idle.distribution = estimator::RelativeErrors{};
        if (law == 3) idle.distribution = estimator::AutoregressiveErrors{};
        if (law == 4) idle.scale.prior = estimator::HalfNormalPrior{2.0};
        FunctionResidual residual = line(8, group("y"));
        residual.add_group(idle);
        for (const auto variance :
             {estimator::Variance::ml, estimator::Variance::restricted, estimator::Variance::integrated}) {
            estimator::EstimateOptions options;
            options.variance = variance;
            const auto result = estimator::estimate(two(), {&residual}, {}, options);
            const auto without = estimator::estimate(two(), {&plain}, {}, options);
            CAPTURE(static_cast<int>(variance), result.message);
            CHECK(result.status == estimator::EstimateStatus::converged);
            CHECK_THAT(result.parameters[1].value, WithinRel(without.parameters[1].value, rounding));
            CHECK_THAT(result.parameters[1].sd, WithinRel(without.parameters[1].sd, rounding));
            CHECK(result.parameters[1].interval_method == estimator::IntervalMethod::t);
            CHECK_THAT(result.parameters[1].lower95, WithinRel(without.parameters[1].lower95, rounding));
            CHECK_THAT(result.log_integral, WithinRel(without.log_integral, rounding));
            CHECK(result.trust_normal == without.trust_normal);
            REQUIRE(result.scales.size() == 2);
            CHECK(result.scales[0].estimated);
            CHECK_THAT(result.scales[0].value, WithinRel(without.scales[0].value, rounding));
            CHECK(result.scales[1].count == 0);
            CHECK_FALSE(result.scales[1].estimated);
            CHECK(result.scales[1].uncertainty == 0.0);
            CHECK(result.scales[1].interval_method == estimator::IntervalMethod::none);
            CHECK_THAT(result.message, ContainsSubstring("idle has no records"));
        }
    }
}

}  // namespace orbid::tests::refusal_test

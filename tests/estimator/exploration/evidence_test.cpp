#include "estimator/exploration/evidence.hpp"

#include <cmath>
#include <limits>
#include <numbers>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "estimator/exploration/predictive_score.hpp"
#include "models/definition/wrong_data.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::evidence_test {

namespace {

/// Ten records of a line with some noise, in five blocks of two.
struct Line {
    Eigen::MatrixXd x{10, 2};
    Eigen::VectorXd y{10};
    Line() {
        y << 0.1, 0.9, 0.4, 1.1, 1.4, 1.0, 1.9, 1.6, 2.2, 1.8;
        for (Eigen::Index i = 0; i < 10; ++i)
            x.row(i) << 1.0, 0.2 * static_cast<double>(i);
    }
    [[nodiscard]] FunctionResidual residual(Eigen::Index columns, double scale = 0.4, bool estimated = false) const {
        FunctionResidual result;
        result.add_group(group("y", scale, estimated));
        for (Eigen::Index b = 0; b < 5; ++b)
            result.add_block(layout("pair " + std::to_string(b), 2),
                             linear(y.segment(2 * b, 2), x.block(2 * b, 0, 2, columns)));
        return result;
    }
};

/// ln N(y; mean, covariance).
double log_normal_density(const Eigen::VectorXd& e, const Eigen::MatrixXd& covariance) {
    const Eigen::LLT<Eigen::MatrixXd> root(covariance);
    return -0.5 * root.matrixL().solve(e).squaredNorm() -
           root.matrixL().toDenseMatrix().diagonal().array().log().sum() -
           0.5 * std::log(2.0 * std::numbers::pi) * static_cast<double>(e.size());
}

std::vector<estimator::FreeParameter> with_priors() {
    std::vector<estimator::FreeParameter> parameters{free_parameter("a", 0.0), free_parameter("b", 0.0)};
    parameters[0].prior = estimator::NormalPrior{0.2, 0.5};
    parameters[1].prior = estimator::NormalPrior{0.8, 0.7};
    return parameters;
}

estimator::EvidenceTerms terms(const std::vector<estimator::FreeParameter>& parameters, FunctionResidual& residual) {
    const auto estimate = estimator::estimate(parameters, {&residual});
    return estimator::evidence_terms(parameters, {&residual}, {}, estimate);
}

}  // namespace

TEST_CASE("the evidence of a linear model with normal priors is exact", "[estimator]") {
    const Line line;
    FunctionResidual residual = line.residual(2);
    const auto parameters = with_priors();
    const auto result = estimator::log_evidence(terms(parameters, residual));
    // y is normal with mean X m and covariance V + X P X^T.
    const Eigen::MatrixXd prior = Eigen::Vector2d(0.25, 0.49).asDiagonal();
    const Eigen::MatrixXd covariance = 0.16 * Eigen::MatrixXd::Identity(10, 10) + line.x * prior * line.x.transpose();
    REQUIRE(result.known);
    // Laplace's integral is exact here: rounding of sums of size 10.
    CHECK_THAT(result.value,
               WithinAbs(log_normal_density(line.y - line.x * Eigen::Vector2d(0.2, 0.8), covariance), 1e-9));
}

TEST_CASE("a prior cut off at bounds that hardly matter keeps its integral", "[estimator]") {
    const Line line;
    FunctionResidual residual = line.residual(2);
    auto parameters = with_priors();
    const double whole = estimator::log_evidence(terms(parameters, residual)).value;
    // Half of the prior of b is cut off, 8 posterior sds away from the data: what is left counts twice.
    parameters[1].prior = estimator::NormalPrior{-0.4, 0.7};
    const double uncut = estimator::log_evidence(terms(parameters, residual)).value;
    parameters[1].lower = -0.4;
    const double cut = estimator::log_evidence(terms(parameters, residual)).value;
    CHECK_THAT(cut - uncut, WithinAbs(std::log(2.0), 1e-9));
    CHECK(std::abs(whole - uncut) > 0.1);
}

TEST_CASE("Bayes factors: shared flat priors cancel, others are refused by name", "[estimator]") {
    const Line line;
    auto parameters = with_priors();
    parameters[0].prior = estimator::FlatPrior{};
    FunctionResidual residual = line.residual(2);
    const auto slope = terms(parameters, residual);
    FunctionResidual constant = line.residual(1);
    const auto level = terms({parameters[0]}, constant);
    const auto evidence = estimator::log_evidence(slope);
    CHECK_FALSE(evidence.known);
    CHECK(std::isnan(evidence.value));
    CHECK_THAT(evidence.message, ContainsSubstring("prior of a is flat"));
    const auto factor = estimator::log_bayes_factor(slope, level);
    REQUIRE(factor.known);
    // With a flat intercept: the density of y up to a constant, (2 pi)^(-9/2) |S|^(-1/2) (1' S^-1 1)^(-1/2) exp(...).
    const auto contrast = [&](const Eigen::MatrixXd& s, const Eigen::VectorXd& e) {
        const Eigen::MatrixXd inverse = s.inverse();
        const Eigen::VectorXd one = Eigen::VectorXd::Ones(10);
        const double weight = one.dot(inverse * one);
        const double projected = e.dot(inverse * e) - std::pow(one.dot(inverse * e), 2) / weight;
        return -0.5 * (std::log(s.determinant()) + std::log(weight) + projected);
    };
    const Eigen::MatrixXd v = 0.16 * Eigen::MatrixXd::Identity(10, 10);
    const Eigen::VectorXd t = line.x.col(1);
    const double expected = contrast(v + 0.49 * t * t.transpose(), line.y - 0.8 * t) - contrast(v, line.y);
    CHECK_THAT(factor.value, WithinAbs(expected, 1e-9));
    CHECK_THAT(estimator::log_bayes_factor(level, slope).value, WithinAbs(-expected, 1e-9));

    parameters[1].prior = estimator::FlatPrior{};
    FunctionResidual flat = line.residual(2);
    const auto refused = estimator::log_bayes_factor(terms(parameters, flat), level);
    CHECK_FALSE(refused.known);
    CHECK_THAT(refused.message, ContainsSubstring("prior of b is flat"));
    // The same name on another scale is another flat density.
    auto logarithmic = parameters;
    logarithmic[0].scale = estimator::Scale::log;
    logarithmic[0].start = 0.5;
    FunctionResidual on_log = line.residual(2);
    CHECK_THAT(estimator::log_bayes_factor(terms(parameters, flat), terms(logarithmic, on_log)).message,
               ContainsSubstring("prior of a is flat"));
    // A scale that is estimated in one of them only.
    FunctionResidual estimated = line.residual(1, 0.4, true);
    CHECK_THAT(estimator::log_bayes_factor(terms({parameters[0]}, estimated), level).message,
               ContainsSubstring("y.scale"));
    FunctionResidual fewer = line.residual(1);
    fewer.deactivate(0);
    CHECK_THAT(estimator::log_bayes_factor(terms({parameters[0]}, fewer), level).message,
               ContainsSubstring("8 and 10 records"));
}

TEST_CASE("no evidence at a bound or of an estimate that has not converged", "[estimator]") {
    const Line line;
    auto parameters = with_priors();
    parameters[0].lower = 0.9;
    parameters[0].start = 1.0;
    FunctionResidual residual = line.residual(2);
    const auto bounded = estimator::log_evidence(terms(parameters, residual));
    CHECK_FALSE(bounded.known);
    CHECK_THAT(bounded.message, ContainsSubstring("a is at its lower bound"));
    estimator::Estimate failed;
    const auto nothing = estimator::log_evidence(estimator::evidence_terms(with_priors(), {&residual}, {}, failed));
    CHECK_FALSE(nothing.known);
    CHECK_THAT(nothing.message, ContainsSubstring("failed"));
}

TEST_CASE("a minimisation that ended just before its minimum has a Bayes factor, and says what it may be off by",
          "[estimator]") {
    const Line line;
    FunctionResidual residual = line.residual(2);
    const auto parameters = with_priors();
    auto estimate = estimator::estimate(parameters, {&residual});
    REQUIRE(estimate.status == estimator::EstimateStatus::converged);
    CHECK(estimate.remaining < 1e-6);
    const auto whole = estimator::evidence_terms(parameters, {&residual}, {}, estimate);
    estimate.status = estimator::EstimateStatus::iteration_limit;
    estimate.remaining = 2.0;
    const auto unfinished = estimator::evidence_terms(parameters, {&residual}, {}, estimate);
    CHECK(unfinished.excess == 2.0);
    CHECK_FALSE(estimator::log_evidence(unfinished).known);
    const auto factor = estimator::log_bayes_factor(whole, unfinished);
    REQUIRE(factor.known);
    CHECK(factor.uncertainty == 2.0);
    CHECK(estimator::log_bayes_factor(whole, whole).uncertainty == 0.0);
    // Too far away, or nobody knows how far.
    for (const double remaining : {4.0, std::numeric_limits<double>::quiet_NaN()}) {
        estimate.remaining = remaining;
        const auto far = estimator::evidence_terms(parameters, {&residual}, {}, estimate);
        CHECK_FALSE(estimator::log_bayes_factor(whole, far).known);
    }
}

TEST_CASE("held-out score of a linear model with known errors: normal with covariance V + J C J^T", "[estimator]") {
    const Line line;
    FunctionResidual residual = line.residual(2);
    const std::vector<estimator::FreeParameter> parameters{free_parameter("a", 0.0), free_parameter("b", 0.0)};
    const auto estimate = estimator::estimate(parameters, {&residual});
    const auto score = estimator::predictive_score(parameters, {&residual}, {}, estimate);
    REQUIRE(score.known);
    REQUIRE(score.folds.size() == 5);
    double sum = 0.0;
    double square = 0.0;
    for (Eigen::Index b = 0; b < 5; ++b) {
        Eigen::MatrixXd x(8, 2);
        Eigen::VectorXd y(8);
        x << line.x.topRows(2 * b), line.x.bottomRows(8 - 2 * b);
        y << line.y.head(2 * b), line.y.tail(8 - 2 * b);
        const Eigen::MatrixXd inverse = (x.transpose() * x).inverse();
        const Eigen::MatrixXd here = line.x.middleRows(2 * b, 2);
        const Eigen::VectorXd e = line.y.segment(2 * b, 2) - here * inverse * x.transpose() * y;
        const double expected =
            log_normal_density(e, 0.16 * (Eigen::MatrixXd::Identity(2, 2) + here * inverse * here.transpose()));
        const estimator::HeldOut& fold = score.folds[static_cast<std::size_t>(b)];
        CHECK_THAT(fold.log_density, WithinAbs(expected, 1e-9));
        CHECK(fold.records == 2);
        CHECK(fold.labels == std::vector<std::string>{"pair " + std::to_string(b)});
        sum += expected;
        square += expected * expected;
    }
    CHECK_THAT(score.log_density, WithinAbs(sum, 1e-8));
    CHECK_THAT(score.standard_error, WithinRel(std::sqrt(5.0 / 4.0 * (square - sum * sum / 5.0)), 1e-6));
    const auto two = estimator::predictive_score(parameters, {&residual}, {}, estimate, 2);
    REQUIRE(two.folds.size() == 2);
    CHECK(two.folds[0].labels == std::vector<std::string>{"pair 0", "pair 2", "pair 4"});
}

TEST_CASE("held-out score with an unknown scale is Student's t to the order of Laplace", "[estimator]") {
    const Line line;
    FunctionResidual residual = line.residual(2, 0.0, true);
    const std::vector<estimator::FreeParameter> parameters{free_parameter("a", 0.0), free_parameter("b", 0.0)};
    const auto estimate = estimator::estimate(parameters, {&residual});
    const auto score = estimator::predictive_score(parameters, {&residual}, {}, estimate);
    REQUIRE(score.known);
    // Multivariate t with nu = 8 - 2 degrees of freedom: ratio of two integrals of the form |X'X|^(-1/2) Gamma(nu / 2)
    // (pi rest)^(-nu/2) / 2.
    const auto log_integral = [](const Eigen::MatrixXd& x, const Eigen::VectorXd& y) {
        const Eigen::MatrixXd inverse = (x.transpose() * x).inverse();
        const double rest = (y - x * inverse * x.transpose() * y).squaredNorm();
        const double nu = static_cast<double>(x.rows() - x.cols());
        return 0.5 * std::log(inverse.determinant()) + std::lgamma(0.5 * nu) -
               0.5 * nu * std::log(std::numbers::pi * rest);
    };
    for (Eigen::Index b = 0; b < 5; ++b) {
        Eigen::MatrixXd x(8, 2);
        Eigen::VectorXd y(8);
        x << line.x.topRows(2 * b), line.x.bottomRows(8 - 2 * b);
        y << line.y.head(2 * b), line.y.tail(8 - 2 * b);
        // Stirling's error 1 / (6 nu) of each integral: 1/48 - 1/36 of their difference.
        CHECK_THAT(score.folds[static_cast<std::size_t>(b)].log_density,
                   WithinAbs(log_integral(line.x, line.y) - log_integral(x, y) - (1.0 / 48.0 - 1.0 / 36.0), 1e-3));
    }
}

TEST_CASE("held-out scores say which fold cannot be had, and refuse a single block", "[estimator]") {
    const Line line;
    FunctionResidual residual;
    residual.add_group(group("y", 0.4, false));
    residual.add_group(group("other"));
    residual.add_block(layout("first", 5), linear(line.y.head(5), line.x.topRows(5)));
    residual.add_block(layout("second", 5), linear(line.y.tail(5), line.x.bottomRows(5)));
    residual.add_block(layout("lonely", 5, 1), linear(line.y.tail(5), line.x.bottomRows(5)));
    const std::vector<estimator::FreeParameter> parameters{free_parameter("a", 0.0), free_parameter("b", 0.0)};
    const auto estimate = estimator::estimate(parameters, {&residual});
    const auto score = estimator::predictive_score(parameters, {&residual}, {}, estimate);
    CHECK_FALSE(score.known);
    CHECK(score.folds[0].known);
    CHECK(score.folds[1].known);
    CHECK_FALSE(score.folds[2].known);
    CHECK_THAT(score.message, ContainsSubstring("lonely"));
    CHECK_THAT(score.folds[2].message, ContainsSubstring("other"));
    CHECK(residual.layout()[0].active);
    CHECK_THROWS_AS(estimator::predictive_score(parameters, {&residual}, {}, estimate, 1), std::invalid_argument);
    CHECK_THROWS_AS(estimator::predictive_score(parameters, {}, {}, estimate), std::invalid_argument);
    CHECK_THROWS_AS(estimator::predictive_score(parameters, {&residual}, {}, estimator::Estimate{}), models::DataError);
    FunctionResidual single;
    single.add_group(group("y", 0.4, false));
    single.add_block(layout("only", 10), linear(line.y, line.x));
    const auto one = estimator::estimate(parameters, {&single});
    CHECK_THROWS_AS(estimator::predictive_score(parameters, {&single}, {}, one), models::DataError);
}

}  // namespace orbid::tests::evidence_test

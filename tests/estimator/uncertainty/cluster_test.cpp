// Clusters on demand: the sandwich of a one-way clustered regression in closed form, and its coverage.

#include <cmath>
#include <random>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include "estimator/estimate/estimate.hpp"
#include "estimator/exploration/marginal.hpp"
#include "estimator/exploration/profile.hpp"
#include "estimator/problem/linearisation.hpp"
#include "estimator/problem/problem.hpp"
#include "estimator/uncertainty/sandwich.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::cluster_test {

namespace {

/// y = 1 + 2 x + a_c + e in `count` clusters, x mostly between them.
struct Panel {
    std::vector<Eigen::MatrixXd> x;
    std::vector<Eigen::VectorXd> y;

    Panel(int count, Eigen::Index each, unsigned seed) {
        std::mt19937_64 generator(seed);
        std::normal_distribution<double> normal;
        for (int c = 0; c < count; ++c) {
            Eigen::MatrixXd own(each, 2);
            Eigen::VectorXd value(each);
            const double level = normal(generator);
            const double effect = 0.5 * normal(generator);
            for (Eigen::Index i = 0; i < each; ++i) {
                own.row(i) << 1.0, level + 0.3 * normal(generator);
                value[i] = 1.0 + 2.0 * own(i, 1) + effect + 0.5 * normal(generator);
            }
            x.push_back(own);
            y.push_back(value);
        }
    }
};

estimator::Estimate estimate_of(const Panel& panel, estimator::Clusters clusters) {
    FunctionResidual residual;
    residual.add_group(group("y"));
    for (std::size_t c = 0; c < panel.x.size(); ++c)
        residual.add_block(layout("unit " + std::to_string(c), panel.y[c].size()), linear(panel.y[c], panel.x[c]));
    estimator::EstimateOptions options;
    options.clusters = clusters;
    options.verdict = false;
    return estimator::estimate({free_parameter("a", 0.0), free_parameter("b", 0.0)}, {&residual}, {}, options);
}

}  // namespace

TEST_CASE("blocks as clusters: the bias-reduced sandwich of a clustered regression", "[estimator]") {
    const Panel panel(7, 5, 3);
    Eigen::Matrix2d gram = Eigen::Matrix2d::Zero();
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    for (std::size_t c = 0; c < panel.x.size(); ++c) {
        gram += panel.x[c].transpose() * panel.x[c];
        right += panel.x[c].transpose() * panel.y[c];
    }
    const Eigen::Matrix2d bread = gram.inverse();
    const Eigen::Vector2d theta = bread * right;
    // CR2: residuals of each cluster times (I - X_c (X^T X)^-1 X_c^T)^(-1/2), written with records and not with
    // columns.
    Eigen::Matrix2d meat = Eigen::Matrix2d::Zero();
    for (std::size_t c = 0; c < panel.x.size(); ++c) {
        const Eigen::MatrixXd hat = panel.x[c] * bread * panel.x[c].transpose();
        const Eigen::MatrixXd left = Eigen::MatrixXd::Identity(hat.rows(), hat.cols()) - hat;
        const Eigen::MatrixXd root = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(left).operatorInverseSqrt();
        const Eigen::Vector2d score = panel.x[c].transpose() * (root * (panel.y[c] - panel.x[c] * theta));
        meat += score * score.transpose();
    }
    const Eigen::Matrix2d covariance = bread * meat * bread;
    const auto result = estimate_of(panel, estimator::Clusters::blocks);
    CAPTURE(result.message);
    REQUIRE(result.status == estimator::EstimateStatus::converged);
    CHECK_THAT(result.message, ContainsSubstring("7 blocks as clusters"));
    const auto independent = estimate_of(panel, estimator::Clusters::none);
    const auto automatic = estimate_of(panel, estimator::Clusters::automatic);
    for (Eigen::Index i = 0; i < 2; ++i) {
        const auto k = static_cast<std::size_t>(i);
        CHECK(result.parameters[k].interval_method == estimator::IntervalMethod::sandwich);
        CHECK_THAT(result.parameters[k].value, WithinRel(theta[i], 1e-10));
        // Derived: rounding through a condition number below 10.
        CHECK_THAT(result.parameters[k].sd, WithinRel(std::sqrt(covariance(i, i)), 1e-10));
        CHECK_THAT(result.parameters[k].laplace_sd, WithinRel(independent.parameters[k].sd, 1e-10));
        CHECK(independent.parameters[k].interval_method == estimator::IntervalMethod::t);
        CHECK(automatic.parameters[k].interval_method == estimator::IntervalMethod::t);
    }
    CHECK_THAT(result.covariance(0, 1), WithinRel(covariance(0, 1), 1e-10));
}

TEST_CASE("degrees of freedom of a sandwich: over all pairs of clusters, written with records", "[estimator]") {
    constexpr Eigen::Index blocks = 3, each = 12, pieces = 4, count = blocks * each;
    std::mt19937_64 generator(8);
    std::normal_distribution<double> normal;
    const auto random = [&](Eigen::Index rows, Eigen::Index columns) {
        return Eigen::MatrixXd(Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return normal(generator); }));
    };
    const Eigen::MatrixXd x = random(count, 2), y = random(count, 1);
    Eigen::MatrixXd q_z = Eigen::MatrixXd::Zero(count, blocks);
    FunctionResidual residual;
    residual.add_group(group("y", 1.0, false));
    for (Eigen::Index b = 0; b < blocks; ++b) {
        const Eigen::MatrixXd z = random(each, 1);
        q_z.block(b * each, b, each, 1) = z.normalized();
        estimator::BlockLayout block = layout("unit " + std::to_string(b), each);
        block.latents = 1;
        residual.add_block(block, linear(y.middleRows(b * each, each), x.middleRows(b * each, each), z),
                           Eigen::VectorXd::Zero(1));
    }
    const std::vector<estimator::ActiveSet> active{residual.initial_set()};
    const auto problem =
        estimator::set_up({free_parameter("a", 0.0), free_parameter("b", 0.0)}, {&residual}, active, {}, {});
    const auto set = estimator::freeze({&residual}, active, problem.channels, problem.laws);
    const auto state = estimator::initial_state(problem, active);
    const auto at = estimator::evaluate({&residual}, set, problem.laws, state.theta, state.latents, true);
    const auto rows = estimator::linearise(set, problem.laws, at.values, problem.coordinates, state.theta, false);

    const Eigen::MatrixXd left = x - q_z * (q_z.transpose() * x);
    const Eigen::MatrixXd triangle = Eigen::LLT<Eigen::MatrixXd>(left.transpose() * left).matrixU();
    std::vector<std::vector<int>> clusters;
    for (const estimator::ActiveBlock& block : set.blocks) {
        clusters.emplace_back();
        for (std::size_t i = 0; i < block.channel().size(); ++i)
            clusters.back().push_back(static_cast<int>(i * pieces / block.channel().size()));
    }
    const estimator::Sandwich sandwich(rows, set, clusters, problem.laws, state.psi, triangle);
    REQUIRE(sandwich.clusters() == blocks * pieces);

    const Eigen::MatrixXd q_theta = left * triangle.inverse();
    const Eigen::MatrixXd rest =
        Eigen::MatrixXd::Identity(count, count) - q_z * q_z.transpose() - q_theta * q_theta.transpose();
    for (const Eigen::Vector2d& direction : {Eigen::Vector2d(1.0, 0.0), Eigen::Vector2d(0.3, -2.0)}) {
        constexpr Eigen::Index size = each / pieces;
        Eigen::MatrixXd v = Eigen::MatrixXd::Zero(count, blocks * pieces);
        const Eigen::VectorXd weight = q_theta * triangle.transpose().inverse() * direction;
        for (Eigen::Index c = 0; c < v.cols(); ++c)
            v.block(c * size, c, size, 1) =
                Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(rest.block(c * size, c * size, size, size))
                    .operatorInverseSqrt() *
                weight.segment(c * size, size);
        const Eigen::MatrixXd m = v.transpose() * rest * v;
        const double expected = m.trace() * m.trace() / m.squaredNorm();
        CHECK(expected > 2.0);
        CHECK(expected < 11.0);
        CHECK_THAT(sandwich.degrees_of_freedom(direction), WithinRel(expected, 1e-10));
    }
}

TEST_CASE("a single block cannot be clustered: Laplace, and the message says so", "[estimator]") {
    const auto result = estimate_of(Panel(1, 12, 4), estimator::Clusters::blocks);
    CHECK(result.status == estimator::EstimateStatus::converged);
    CHECK(result.parameters[1].interval_method == estimator::IntervalMethod::t);
    CHECK_THAT(result.message, ContainsSubstring("blocks are too few (1, at least 3 are needed)"));
}

TEST_CASE("residuals that repeat each other all along: no interval, and the message says so once", "[estimator]") {
    // A slope alone through a line with an offset: residuals of one sign for two thirds of the record.
    constexpr Eigen::Index n = 200;
    Eigen::MatrixXd x(n, 1);
    Eigen::VectorXd y(n);
    for (Eigen::Index i = 0; i < n; ++i) {
        const double t = static_cast<double>(i + 1) / n;
        x(i, 0) = t;
        y(i) = 2.0 * t + 1.0;
    }
    FunctionResidual residual;
    estimator::Group ordered = group("y");
    ordered.ordered = true;
    ordered.interval = 1.0;
    residual.add_group(ordered);
    residual.add_block(layout("record", n), linear(y, x));
    estimator::EstimateOptions options;
    options.verdict = false;
    const auto result = estimator::estimate({free_parameter("slope", 0.0)}, {&residual}, {}, options);
    CAPTURE(result.message);
    REQUIRE(result.status == estimator::EstimateStatus::converged);
    CHECK_THAT(result.message, ContainsSubstring("too few independent values for slope:"));
    const auto& slope = result.parameters[0];
    CHECK(slope.interval_method == estimator::IntervalMethod::too_few_independent);
    // The offset moves the slope by 1.5, far beyond what independent errors would allow: no figure is better than that.
    CHECK(slope.value - 5.0 * slope.laplace_sd > 2.0);
    CHECK(std::isnan(slope.sd));
    CHECK(std::isnan(slope.lower95));
    CHECK(std::isnan(slope.upper95));
    const auto profile = estimator::profiles({free_parameter("slope", 0.0)}, {&residual}, options, result);
    CHECK_FALSE(profile[0].known);
    CHECK_THAT(profile[0].message, ContainsSubstring("too few independent values"));
    const auto marginal = estimator::marginals({free_parameter("slope", 0.0)}, {&residual}, options, result);
    CHECK_FALSE(marginal[0].known);
}

// 200 replicates with effects of whole clusters: 190 expected, binomial sd 3.1, four of them below are 177.6:
// the same bound tells an interval that covers from one that does not (measured: 190 and 151).
TEST_CASE("with effects of clusters the sandwich covers and Laplace does not", "[estimator]") {
    int covered = 0;
    int naive = 0;
    for (unsigned run = 0; run < 200; ++run) {
        const auto result = estimate_of(Panel(20, 6, 500 + run), estimator::Clusters::blocks);
        const auto& b = result.parameters[1];
        if (b.lower95 <= 2.0 && 2.0 <= b.upper95) ++covered;
        if (std::abs(b.value - 2.0) <= 1.96 * b.laplace_sd) ++naive;
    }
    CAPTURE(covered, naive);
    CHECK(covered >= 178);
    CHECK(naive < 178);
}

}  // namespace orbid::tests::cluster_test

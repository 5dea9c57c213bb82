#include "estimator/algebra/block_arrow.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/QR>

#include "tests/catch.hpp"
#include "tests/estimator/problem/stacked_problem.hpp"

namespace block_arrow_test {

using namespace orbid::estimator;
using orbid::estimator::test::Numbers;
using orbid::estimator::test::Solution;
using orbid::estimator::test::StackedBlock;
using orbid::estimator::test::StackedProblem;

namespace {

/// Largest difference of steps, parameters and ln|R| from the dense factorisation in quadruple precision, relative to
/// the largest unknown.
struct Difference {
    double step = 0.0;
    double determinant = 0.0;
    double covariance = 0.0;
};

/// All that visit_covariance() passes.
struct SelectedCovariance {
    std::vector<Eigen::MatrixXd> block;
    std::vector<Eigen::MatrixXd> link;
};

SelectedCovariance selected_covariance(const BlockArrow& arrow, const ReducedProblem& reduced_problem,
                                       const Eigen::MatrixXd& triangle) {
    SelectedCovariance result;
    result.block.resize(arrow.blocks.size());
    result.link.resize(arrow.blocks.size());
    const auto into = [](std::vector<Eigen::MatrixXd>& places) {
        return [&places](std::size_t b, const Eigen::Ref<const Eigen::MatrixXd>& p) { places[b] = p; };
    };
    visit_covariance(arrow, reduced_problem, inverse_square(triangle), into(result.block), into(result.link));
    return result;
}

Difference difference(const StackedProblem& problem, double mu = 0.0) {
    const BlockArrow arrow = factorise(problem.blocks(), problem.parameters);
    const ReducedProblem reduced_problem = condense(arrow, mu);
    const Solution exact = test::dense_solution(problem, arrow, mu);
    const Eigen::VectorXd d = -reduced_problem.r.triangularView<Eigen::Upper>().solve(reduced_problem.rhs);
    const auto z = latent_steps(arrow, reduced_problem, d);
    const SelectedCovariance restricted = selected_covariance(arrow, reduced_problem, reduced_problem.r);
    const SelectedCovariance held = selected_covariance(arrow, reduced_problem, Eigen::MatrixXd());
    Difference result;
    const double size = exact.unknowns.lpNorm<Eigen::Infinity>();
    const Eigen::Index q = problem.parameters;
    result.step = (d - exact.unknowns.tail(q)).lpNorm<Eigen::Infinity>() / size;
    result.determinant = std::abs(log_abs_determinant(reduced_problem) - exact.log_determinant);
    for (std::size_t b = 0; b < z.size(); ++b) {
        const Eigen::Index l = z[b].size();
        if (l == 0) continue;
        const Eigen::Index at = problem.offset(b);
        result.step = std::max(result.step, (z[b] - exact.unknowns.segment(at, l)).lpNorm<Eigen::Infinity>() / size);
        const auto compare = [&result](const Eigen::MatrixXd& found, const Eigen::MatrixXd& expected) {
            REQUIRE(found.rows() == expected.rows());
            REQUIRE(found.cols() == expected.cols());
            result.covariance = std::max(result.covariance, (found - expected).norm() / expected.norm());
        };
        compare(restricted.block[b], exact.joint({{at, l}, {problem.offset(z.size()), q}}));
        compare(held.block[b], exact.held({{at, l}}));
        const auto& rows = problem.block[b];
        if (rows.link.rows() == 0 || rows.next < 0) continue;
        const auto next = static_cast<std::size_t>(rows.next);
        const std::pair<Eigen::Index, Eigen::Index> after{problem.offset(next), problem.block[next].latents};
        compare(restricted.link[b], exact.joint({{at, l}, after, {problem.offset(z.size()), q}}));
        compare(held.link[b], exact.held({{at, l}, after}));
    }
    return result;
}

}  // namespace

TEST_CASE("blocks, chains and cyclic chains agree with a dense factorisation", "[estimator]") {
    for (const int blocks : {1, 2, 3, 4, 5, 8, 11}) {
        for (const auto shape : {test::Shape::independent, test::Shape::chain, test::Shape::cyclic}) {
            for (const double weight : {1.0, 1e2, 1e5, 1e8, 1e10}) {
                for (const double mu : {0.0, 0.3}) {
                    const StackedProblem problem = test::random_problem(blocks, 2, 3, shape, weight, 7 * blocks);
                    CAPTURE(blocks, static_cast<int>(shape), weight, mu);
                    const Difference found = difference(problem, mu);
                    // Worst measured 6e-15, 1.1e-13 and 1.2e-14; bounds are ten times that.
                    CHECK(found.step < 6e-14);
                    CHECK(found.determinant < 1.2e-12);
                    CHECK(found.covariance < 1.2e-13);
                }
            }
        }
    }
}

namespace {

/// A chain with growth e^0.8 and contraction e^-14 per link along directions that turn from node to node. Residuals e
/// of the own rows and multipliers lambda of the links are chosen so that the normal equations hold exactly at the
/// chosen states and parameters.
StackedProblem unstable_chain(int nodes, double weight, bool cyclic, Eigen::VectorXd& d,
                              std::vector<Eigen::VectorXd>& z) {
    Numbers random(11);
    constexpr Eigen::Index l = 2;
    constexpr Eigen::Index q = 2;
    StackedProblem problem;
    problem.parameters = q;
    d = random(q, 1);
    std::vector<Eigen::VectorXd> lambda;
    for (int b = 0; b < nodes; ++b) {
        z.emplace_back(random(l, 1));
        lambda.emplace_back(random(l, 1));
        StackedBlock block;
        block.latents = l;
        if (cyclic || b + 1 < nodes) {
            block.next = (b + 1) % nodes;
            const Eigen::Rotation2Dd turn(random());
            const Eigen::Rotation2Dd after(random());
            block.link = Eigen::MatrixXd::Zero(l, 2 * l + q + 1);
            block.link.leftCols(l) = after.toRotationMatrix() *
                                     Eigen::Vector2d(std::exp(0.8), std::exp(-14.0)).asDiagonal() *
                                     turn.toRotationMatrix();
            block.link.middleCols(l, l) = -Eigen::MatrixXd::Identity(l, l);
            block.link.middleCols(2 * l, q) = random(l, q);
            block.link *= weight;
        }
        problem.block.push_back(block);
    }
    Eigen::VectorXd gradient = Eigen::VectorXd::Zero(q);
    for (int b = 0; b < nodes; ++b) {
        StackedBlock& block = problem.block[static_cast<std::size_t>(b)];
        const auto i = static_cast<std::size_t>(b);
        Eigen::VectorXd pull = Eigen::VectorXd::Zero(l);
        if (block.link.rows() > 0) {
            const auto next = static_cast<std::size_t>(block.next);
            block.link.rightCols(1) = lambda[i] / weight - block.link.leftCols(l) * z[i] -
                                      block.link.middleCols(l, l) * z[next] - block.link.middleCols(2 * l, q) * d;
            pull += block.link.leftCols(l).transpose() * (lambda[i] / weight);
            gradient += block.link.middleCols(2 * l, q).transpose() * (lambda[i] / weight);
        }
        const std::size_t before = b > 0 ? i - 1 : static_cast<std::size_t>(nodes) - 1;
        if (b > 0 || cyclic)
            pull += problem.block[before].link.middleCols(l, l).transpose() * (lambda[before] / weight);
        const Eigen::MatrixXd a_z = random(l, l) + 2.0 * Eigen::MatrixXd::Identity(l, l);
        const Eigen::MatrixXd a = random(l, q);
        const Eigen::VectorXd e = a_z.transpose().partialPivLu().solve(-pull);
        block.own = Eigen::MatrixXd::Zero(l + q, l + q + 1);
        block.own.topRows(l) << a_z, a, e - a_z * z[i] - a * d;
        gradient += a.transpose() * e;
    }
    // Rows on the parameters alone in the last block bring their own gradient to zero.
    StackedBlock& last = problem.block.back();
    last.own.block(l, l, q, q).setIdentity();
    last.own.block(l, l + q, q, 1) = -gradient - d;
    return problem;
}

}  // namespace

TEST_CASE("long chains with growing and contracting directions keep their digits", "[estimator]") {
    for (const bool cyclic : {false, true}) {
        for (const double weight : {1.0, 1e4, 1e7, 1e10}) {
            CAPTURE(cyclic, weight);
            Eigen::VectorXd d;
            std::vector<Eigen::VectorXd> z;
            const StackedProblem problem = unstable_chain(2001, weight, cyclic, d, z);
            const BlockArrow arrow = factorise(problem.blocks(), problem.parameters);
            const ReducedProblem reduced_problem = condense(arrow, 0.0);
            const Eigen::VectorXd found = -reduced_problem.r.triangularView<Eigen::Upper>().solve(reduced_problem.rhs);
            const auto states = latent_steps(arrow, reduced_problem, found);
            double worst = (found - d).norm();
            for (std::size_t b = 0; b < z.size(); ++b)
                worst = std::max(worst, (states[b] - z[b]).norm());
            CAPTURE(worst);
            CHECK(worst < 2.6e-11);  // ten times the worst measured
            // Linear cost: 2001 nodes take 2000 eliminations (the last two together), 1 more when counted one by one,
            // and every elimination has rows of its own states, its two neighbours' and the parameters only.
            std::size_t eliminations = 0;
            for (const ChainLevel& level : reduced_problem.chains[0]->levels) {
                eliminations += level.steps.size();
                for (const Elimination& step : level.steps)
                    CHECK(level.rows(step).size() <= 4 * (3 * 2 + 2 + 1));
            }
            CHECK(eliminations == 2000);
        }
    }
}

TEST_CASE("tight links approach the constrained least-squares solution", "[estimator]") {
    const StackedProblem tight = test::random_problem(6, 2, 3, test::Shape::chain, 1e10, 5);
    const BlockArrow arrow = factorise(tight.blocks(), 3);
    const ReducedProblem reduced_problem = condense(arrow, 0.0);
    const Eigen::VectorXd d = -reduced_problem.r.triangularView<Eigen::Upper>().solve(reduced_problem.rhs);
    const auto z = latent_steps(arrow, reduced_problem, d);
    // Null space of the constraints C x = -c: x = x0 + N y, min ||A (x0 + N y) + w||.
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(36, 16);
    Eigen::MatrixXd c = Eigen::MatrixXd::Zero(10, 16);
    for (Eigen::Index b = 0; b < 6; ++b) {
        const auto& block = tight.block[static_cast<std::size_t>(b)];
        a.block(6 * b, 2 * b, 6, 2) = block.own.leftCols(2);
        a.block(6 * b, 12, 6, 4) = block.own.rightCols(4);
        if (b == 5) continue;
        c.block(2 * b, 2 * b, 2, 4) = block.link.leftCols(4) / 1e10;
        c.block(2 * b, 12, 2, 4) = block.link.rightCols(4) / 1e10;
    }
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(c.leftCols(15).transpose());
    const Eigen::MatrixXd q = qr.householderQ();
    const Eigen::VectorXd x0 = c.leftCols(15).completeOrthogonalDecomposition().solve(-c.col(15));
    const Eigen::MatrixXd null = q.rightCols(5);
    const Eigen::VectorXd y = (a.leftCols(15) * null).householderQr().solve(-(a.leftCols(15) * x0 + a.col(15)));
    const Eigen::VectorXd x = x0 + null * y;
    CHECK((x.tail(3) - d).norm() < 1e-12 * x.norm());
    for (Eigen::Index b = 0; b < 6; ++b)
        CHECK((x.segment(2 * b, 2) - z[static_cast<std::size_t>(b)]).norm() < 1e-12 * x.norm());
}

TEST_CASE("the order of the blocks of a chain does not matter", "[estimator]") {
    const StackedProblem problem = test::random_problem(9, 2, 3, test::Shape::cyclic, 1e6, 3);
    StackedProblem shuffled = problem;
    const std::vector<std::size_t> place{4, 0, 7, 2, 8, 1, 6, 3, 5};
    for (std::size_t b = 0; b < 9; ++b) {
        shuffled.block[place[b]] = problem.block[b];
        shuffled.block[place[b]].next =
            static_cast<std::ptrdiff_t>(place[static_cast<std::size_t>(problem.block[b].next)]);
    }
    const auto solve = [](const StackedProblem& p, std::vector<Eigen::VectorXd>& z) {
        const BlockArrow arrow = factorise(p.blocks(), p.parameters);
        const ReducedProblem reduced_problem = condense(arrow, 0.0);
        const Eigen::VectorXd d = -reduced_problem.r.triangularView<Eigen::Upper>().solve(reduced_problem.rhs);
        z = latent_steps(arrow, reduced_problem, d);
        return d;
    };
    std::vector<Eigen::VectorXd> z;
    std::vector<Eigen::VectorXd> z_shuffled;
    const Eigen::VectorXd d = solve(problem, z);
    CHECK((solve(shuffled, z_shuffled) - d).norm() < 1e-12 * d.norm());
    for (std::size_t b = 0; b < 9; ++b)
        CHECK((z_shuffled[place[b]] - z[b]).norm() < 1e-12 * d.norm());
}

TEST_CASE("states that nothing decides stay put, those that a link decides do not", "[estimator]") {
    StackedProblem problem = test::random_problem(5, 2, 1, test::Shape::chain, 1e6, 9);
    problem.block[2].own.col(1).setZero();  // decided by the links alone
    const BlockArrow decided = factorise(problem.blocks(), 1);
    CHECK_FALSE(decided.blocks[2].dead[1]);
    CHECK(decided.blocks[2].norm[1] > 0.0);
    CHECK(decided.blocks[2].norm[1] < 1e3);  // the links' weight stays out of the damping
    CHECK(difference(problem).step < 1e-12);
    problem.block[1].link.col(3).setZero();
    problem.block[2].link.col(1).setZero();
    const BlockArrow arrow = factorise(problem.blocks(), 1);
    CHECK(arrow.blocks[2].dead[1]);
    for (const double mu : {0.0, 0.1}) {
        const ReducedProblem reduced_problem = condense(arrow, mu);
        const auto z = latent_steps(arrow, reduced_problem, Eigen::VectorXd::Ones(1));
        CHECK(z[2][1] == 0.0);
        CHECK(z[2].allFinite());
        CHECK(selected_covariance(arrow, reduced_problem, reduced_problem.r).block[2](1, 1) == 0.0);
        CHECK(std::isfinite(log_abs_determinant(reduced_problem)));
    }
}

TEST_CASE("the model's change counts the links", "[estimator]") {
    const StackedProblem problem = test::random_problem(4, 2, 3, test::Shape::cyclic, 10.0, 2);
    const BlockArrow arrow = factorise(problem.blocks(), 3);
    const ReducedProblem reduced_problem = condense(arrow, 0.0);
    const Eigen::VectorXd d = -reduced_problem.r.triangularView<Eigen::Upper>().solve(reduced_problem.rhs);
    const auto z = latent_steps(arrow, reduced_problem, d);
    const ModelChange change = model_change(arrow, d, z);
    double before = 0.0, of_blocks = 0.0;
    for (const double each : model_changes(arrow, d, z))
        of_blocks += each;
    for (const auto& block : problem.block)
        before += block.own.rightCols(1).squaredNorm() + block.link.rightCols(1).squaredNorm();
    // At the minimum w^T A d = -||A d||^2, and what is left of ||w||^2 is rest^2.
    CHECK(std::abs(change.linear + change.quadratic) < 1e-13 * before);
    CHECK(std::abs(before - change.quadratic - reduced_problem.rest * reduced_problem.rest) < 1e-13 * before);
    CHECK(std::abs(of_blocks - change.linear - 0.5 * change.quadratic) < 1e-13 * before);
}

TEST_CASE("panels of a tall matrix give the triangle of the whole", "[estimator]") {
    Numbers random(4);
    const Eigen::MatrixXd a = random(5000, 7);
    const Eigen::MatrixXd r = upper_triangle(a);
    CHECK((r.transpose() * r - a.transpose() * a).norm() < 1e-12 * a.squaredNorm());
    CHECK(r.isUpperTriangular());
}

TEST_CASE("links that do not fit are refused", "[estimator]") {
    auto blocks = test::random_problem(3, 2, 1, test::Shape::chain, 1.0, 1).blocks();
    auto wrong = blocks;
    wrong[0].link = wrong[0].link.leftCols(5).eval();
    CHECK_THROWS_AS(factorise(wrong, 1), std::invalid_argument);
    wrong = blocks;
    wrong[0].next = 3;
    CHECK_THROWS_AS(factorise(wrong, 1), std::invalid_argument);
    wrong = blocks;
    wrong[0].next = 2;  // as block 1 does
    CHECK_THROWS_AS(factorise(wrong, 1), std::invalid_argument);
}

}  // namespace block_arrow_test

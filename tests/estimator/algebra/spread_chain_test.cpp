// Chains that are spread over ranks, against the same chains in one process: steps, R factor, determinant, covariances.

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "tests/catch.hpp"
#include "tests/estimator/algebra/part_of_problem.hpp"
#include "tests/estimator/problem/stacked_problem.hpp"
#include "tests/estimator/ranks/on_ranks.hpp"

namespace spread_chain_test {

using namespace orbid::estimator;
using orbid::estimator::test::Numbers;
using orbid::estimator::test::part_of;
using orbid::estimator::test::StackedBlock;
using orbid::estimator::test::StackedProblem;
using orbid::tests::on_ranks;

namespace {

/// What the algebra finds of a problem: all that must not depend on where the chain is cut.
struct Found {
    Eigen::MatrixXd square;  ///< R^T R
    Eigen::VectorXd d;
    double rest = 0.0;
    double log_determinant = 0.0;
    ModelChange change;
    std::vector<Eigen::VectorXd> z;
    std::vector<Eigen::VectorXd> norm;
    std::vector<std::vector<bool>> dead;
    std::vector<Eigen::MatrixXd> node;
    std::vector<Eigen::MatrixXd> link;
};

Found found_in(std::vector<BlockTriangle> blocks, Eigen::Index q, double mu, const Spread& spread) {
    const BlockArrow arrow = factorise(std::move(blocks), q, spread);
    const ReducedProblem reduced = condense(arrow, mu);
    Found found;
    found.square = reduced.r.transpose() * reduced.r;
    found.d = -reduced.r.triangularView<Eigen::Upper>().solve(reduced.rhs);
    found.rest = reduced.rest;
    found.log_determinant = log_abs_determinant(reduced);
    found.z = latent_steps(arrow, reduced, found.d);
    found.change = model_change(arrow, found.d, found.z);
    for (const BlockTriangle& block : arrow.blocks) {
        found.norm.push_back(block.norm);
        found.dead.push_back(block.dead);
    }
    found.node.resize(arrow.blocks.size());
    found.link.resize(arrow.blocks.size());
    const auto into = [](std::vector<Eigen::MatrixXd>& places) {
        return [&places](std::size_t b, const Eigen::Ref<const Eigen::MatrixXd>& p) { places[b] = p; };
    };
    visit_covariance(arrow, reduced, inverse_square(reduced.r), into(found.node), into(found.link));
    return found;
}

/// The same by ranks that begin at these blocks, put together again. Where two ranks have a block, both must agree.
Found found_by_ranks(const StackedProblem& problem, const std::vector<std::size_t>& begins, double mu) {
    const std::size_t count = begins.size();
    std::vector<Found> of(count);
    const auto linked = [&](std::size_t rank) {
        return rank > 0 && rank < count && problem.block[begins[rank] - 1].next >= 0;
    };
    on_ranks(static_cast<int>(count), [&](Ranks& ranks) {
        Collective all(ranks);
        const auto own = static_cast<std::size_t>(ranks.rank());
        const std::size_t end = own + 1 < count ? begins[own + 1] : problem.block.size();
        Spread spread;
        spread.ranks = &all;
        if (linked(own)) spread.before = 0;
        if (linked(own + 1)) spread.after = static_cast<std::ptrdiff_t>(end - begins[own]);
        of[own] = found_in(part_of(problem, begins[own], end, linked(own + 1)), problem.parameters, mu, spread);
        all.meet();
    });
    Found found = of[0];
    for (std::size_t rank = 1; rank < count; ++rank) {
        const Found& next = of[rank];
        // Numbers of all ranks together are the same bytes on each.
        REQUIRE(next.d == of[0].d);
        REQUIRE(next.square == of[0].square);
        REQUIRE(next.log_determinant == of[0].log_determinant);
        REQUIRE(next.change.linear == of[0].change.linear);
        if (linked(rank)) {
            REQUIRE(found.z.back() == next.z.front());
            REQUIRE(found.dead.back() == next.dead.front());
            REQUIRE((found.node.back() - next.node.front()).norm() <= 1e-13 * next.node.front().norm());
            found.z.pop_back();
            found.norm.pop_back();
            found.dead.pop_back();
            found.node.pop_back();
            found.link.pop_back();
        }
        const auto append = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
        append(found.z, next.z);
        append(found.norm, next.norm);
        append(found.dead, next.dead);
        append(found.node, next.node);
        append(found.link, next.link);
    }
    return found;
}

/// Largest relative differences of numbers of all ranks, of latent states, and of covariances.
struct Difference {
    double common = 0.0;
    double states = 0.0;
    double covariance = 0.0;
};

Difference difference(const Found& a, const Found& b) {
    Difference result;
    const auto relative = [](const auto& x, const auto& y) {
        return y.norm() > 0.0 ? (x - y).norm() / y.norm() : x.norm();
    };
    result.common = std::max({relative(a.square, b.square), relative(a.d, b.d),
                              std::abs(a.log_determinant - b.log_determinant) / (1.0 + std::abs(b.log_determinant)),
                              std::abs(a.change.linear - b.change.linear) / std::abs(b.change.linear),
                              std::abs(a.change.quadratic - b.change.quadratic) / std::abs(b.change.quadratic)});
    REQUIRE(a.z.size() == b.z.size());
    double largest = 0.0;
    for (const Eigen::VectorXd& z : b.z)
        largest = std::max(largest, z.norm());
    for (std::size_t i = 0; i < b.z.size(); ++i) {
        CHECK(a.dead[i] == b.dead[i]);
        result.states = std::max({result.states, (a.z[i] - b.z[i]).norm() / largest, relative(a.norm[i], b.norm[i])});
        result.covariance = std::max(result.covariance, relative(a.node[i], b.node[i]));
        REQUIRE(a.link[i].size() == b.link[i].size());
        if (b.link[i].size() > 0) result.covariance = std::max(result.covariance, relative(a.link[i], b.link[i]));
    }
    return result;
}

/// Begins of so many ranks in a chain of so many blocks, about evenly, two blocks or more on the last one.
std::vector<std::size_t> even_begins(std::size_t blocks, std::size_t ranks) {
    std::vector<std::size_t> begins;
    for (std::size_t r = 0; r < ranks; ++r)
        begins.push_back(r * (blocks - 1) / ranks);
    return begins;
}

/// Links with growth and contraction e^+-rate along directions that turn from node to node.
StackedProblem turning_chain(int nodes, double rate, double weight, std::uint64_t seed) {
    Numbers random(seed);
    StackedProblem problem = test::random_problem(nodes, 2, 2, test::Shape::chain, weight, seed);
    for (StackedBlock& block : problem.block) {
        if (block.link.rows() == 0) continue;
        const auto turn = [&random] {
            const double angle = 3.0 * random();
            return Eigen::Matrix2d{{std::cos(angle), -std::sin(angle)}, {std::sin(angle), std::cos(angle)}};
        };
        block.link.leftCols(2) =
            weight * turn() * Eigen::Vector2d(std::exp(rate), std::exp(-rate)).asDiagonal() * turn();
    }
    return problem;
}

}  // namespace

TEST_CASE("A chain over ranks gives what one process gives", "[estimator][ranks]") {
    Difference worst;
    for (const int blocks : {5, 6, 8, 11, 33}) {
        for (const double weight : {1.0, 1e3, 1e6, 1e10}) {
            for (const double mu : {0.0, 0.3}) {
                const StackedProblem problem =
                    test::random_problem(blocks, 2, 3, test::Shape::chain, weight, 7 * static_cast<unsigned>(blocks));
                const Found one = found_in(problem.blocks(), problem.parameters, mu, {});
                for (const std::size_t ranks : {1, 2, 3, 4}) {
                    CAPTURE(blocks, weight, mu, ranks);
                    const auto begins = even_begins(problem.block.size(), ranks);
                    const Difference found = difference(found_by_ranks(problem, begins, mu), one);
                    worst.common = std::max(worst.common, found.common);
                    worst.states = std::max(worst.states, found.states);
                    worst.covariance = std::max(worst.covariance, found.covariance);
                }
            }
        }
    }
    CAPTURE(worst.common, worst.states, worst.covariance);
    CHECK(worst.common < 1e-12);
    CHECK(worst.states < 1e-12);
    CHECK(worst.covariance < 1e-12);
}

TEST_CASE("Growing and contracting directions keep their digits across ranks", "[estimator][ranks]") {
    // Ten times the worst measured. Against 31 nodes in quadruple precision states are as right as in one process;
    // covariances are not: 2e-7 instead of 1e-10 at e^5, and at e^14 too few digits are left to compare.
    struct Case {
        double rate, states;
        std::optional<double> covariance;
    };
    for (const Case& at : {Case{0.8, 1e-12, 1e-12}, Case{5.0, 1e-11, 1e-6}, Case{14.0, 1e-8, std::nullopt}}) {
        for (const double weight : {1.0, 1e4, 1e8}) {
            const StackedProblem problem = turning_chain(301, at.rate, weight, 5);
            const Found one = found_in(problem.blocks(), problem.parameters, 0.0, {});
            for (const std::size_t ranks : {2, 3, 4, 7}) {
                const auto begins = even_begins(problem.block.size(), ranks);
                const Difference found = difference(found_by_ranks(problem, begins, 0.0), one);
                CAPTURE(at.rate, weight, ranks, found.common, found.states, found.covariance);
                CHECK(found.common < at.states);
                CHECK(found.states < at.states);
                if (at.covariance) CHECK(found.covariance < *at.covariance);
            }
        }
    }
}

TEST_CASE("Several chains and lone blocks lie anywhere between ranks", "[estimator][ranks]") {
    StackedProblem problem = test::random_problem(20, 2, 3, test::Shape::chain, 1e3, 21);
    for (const std::size_t last : {4U, 5U, 12U}) {  // chains 0-4, 6-12, 13-19; block 5 alone
        problem.block[last].link.resize(0, 0);
        problem.block[last].next = -1;
    }
    for (const double mu : {0.0, 0.2}) {
        const Found one = found_in(problem.blocks(), problem.parameters, mu, {});
        for (const std::vector<std::size_t>& begins :
             {std::vector<std::size_t>{0, 5}, {0, 6, 13}, {0, 2, 8, 15}, {0, 3, 6, 9, 13, 18}, {0, 7, 8, 9, 10}}) {
            const Difference found = difference(found_by_ranks(problem, begins, mu), one);
            CAPTURE(mu, begins.size(), begins[1]);
            CHECK(found.common < 1e-12);
            CHECK(found.states < 1e-12);
            CHECK(found.covariance < 1e-12);
        }
    }
}

TEST_CASE("States without own rows or without any, at the border of ranks too", "[estimator][ranks]") {
    for (const std::size_t place : {3U, 4U, 6U}) {  // inside the first rank, at its end, inside the second
        StackedProblem problem = test::random_problem(9, 2, 1, test::Shape::chain, 1e6, 9);
        problem.block[place].own.col(1).setZero();
        const std::vector<std::size_t> begins{0, 4};
        CAPTURE(place);
        const Found decided = found_in(problem.blocks(), 1, 0.1, {});
        CHECK_FALSE(decided.dead[place][1]);
        Difference found = difference(found_by_ranks(problem, begins, 0.1), decided);
        CHECK(found.common < 1e-12);
        CHECK(found.states < 1e-12);
        problem.block[place - 1].link.col(3).setZero();
        problem.block[place].link.col(1).setZero();
        for (const double mu : {0.0, 0.1}) {
            const Found one = found_in(problem.blocks(), 1, mu, {});
            CHECK(one.dead[place][1]);
            CHECK(one.z[place][1] == 0.0);
            found = difference(found_by_ranks(problem, begins, mu), one);
            CHECK(found.common < 1e-12);
            CHECK(found.states < 1e-12);
            CHECK(found.covariance < 1e-12);
        }
    }
}

TEST_CASE("The same number of ranks gives the same bytes", "[estimator][ranks]") {
    const StackedProblem problem = turning_chain(64, 2.0, 1e3, 8);
    const std::vector<std::size_t> begins = even_begins(64, 3);
    const Found once = found_by_ranks(problem, begins, 0.1);
    const Found again = found_by_ranks(problem, begins, 0.1);
    CHECK(once.square == again.square);
    CHECK(once.d == again.d);
    CHECK(once.log_determinant == again.log_determinant);
    CHECK(once.z == again.z);
    for (std::size_t b = 0; b < once.node.size(); ++b)
        CHECK(once.node[b] == again.node[b]);
}

}  // namespace spread_chain_test

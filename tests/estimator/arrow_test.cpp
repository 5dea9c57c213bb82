#include "estimator/arrow.hpp"

#include <cmath>
#include <stdexcept>
#include <vector>

#include <Eigen/LU>
#include <Eigen/QR>

#include "tests/catch.hpp"
#include "tests/estimator/stacked_problem.hpp"

using namespace orbid::estimator;
using orbid::estimator::test::Solution;
using orbid::estimator::test::StackedProblem;

namespace {

/// Largest difference of steps, parameters and ln|R| from the dense factorisation in quadruple precision, relative to
/// the largest unknown.
struct Difference {
    double step = 0.0;
    double determinant = 0.0;
    double covariance = 0.0;
};

Difference difference(const StackedProblem& problem, double mu = 0.0) {
    const Arrow arrow = factorise(problem.blocks(), problem.parameters);
    const Condensed condensed = condense(arrow, mu);
    const Solution exact = test::dense_solution(problem, arrow, mu);
    const Eigen::VectorXd d = -condensed.r.triangularView<Eigen::Upper>().solve(condensed.rhs);
    const auto z = latent_steps(arrow, condensed, d);
    const SelectedCovariance restricted = selected_covariance(arrow, condensed, condensed.r);
    const SelectedCovariance held = selected_covariance(arrow, condensed, Eigen::MatrixXd());
    Difference result;
    const double size = exact.unknowns.lpNorm<Eigen::Infinity>();
    const Eigen::Index q = problem.parameters;
    result.step = (d - exact.unknowns.tail(q)).lpNorm<Eigen::Infinity>() / size;
    result.determinant = std::abs(log_abs_determinant(condensed) - exact.log_determinant);
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
                    CHECK(found.step < 1e-12);
                    CHECK(found.determinant < 1e-11);
                    CHECK(found.covariance < 1e-11);
                }
            }
        }
    }
}

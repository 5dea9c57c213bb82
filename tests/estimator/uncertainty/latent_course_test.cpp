// Latent states that follow the parameters, against one dense least-squares problem.

#include "estimator/uncertainty/latent_course.hpp"

#include <Eigen/QR>

#include "tests/catch.hpp"
#include "tests/estimator/problem/stacked_problem.hpp"

namespace orbid::tests::latent_course_test {

using namespace orbid::estimator;
using orbid::estimator::test::Shape;
using orbid::estimator::test::StackedBlock;
using orbid::estimator::test::StackedProblem;

TEST_CASE("latent states follow the parameters as in one dense problem", "[estimator]") {
    constexpr Eigen::Index l = 2, q = 3;
    constexpr int count = 7;
    const StackedProblem problem = test::random_problem(count, l, q, Shape::chain, 10.0, 5);
    Eigen::Index rows = 0;
    for (const StackedBlock& block : problem.block)
        rows += block.own.rows() + block.link.rows();
    Eigen::MatrixXd states = Eigen::MatrixXd::Zero(rows, l * count);
    Eigen::MatrixXd parameters(rows, q);
    Eigen::Index row = 0;
    for (std::size_t b = 0; b < problem.block.size(); ++b) {
        const StackedBlock& block = problem.block[b];
        states.block(row, problem.offset(b), block.own.rows(), l) = block.own.leftCols(l);
        parameters.middleRows(row, block.own.rows()) = block.own.middleCols(l, q);
        row += block.own.rows();
        if (block.link.rows() == 0) continue;
        states.block(row, problem.offset(b), l, l) = block.link.leftCols(l);
        states.block(row, problem.offset(b + 1), l, l) = block.link.middleCols(l, l);
        parameters.middleRows(row, l) = block.link.middleCols(2 * l, q);
        row += l;
    }
    const Eigen::MatrixXd exact = -states.householderQr().solve(parameters);

    const BlockArrow arrow = factorise(problem.blocks(), q);
    const LatentCourse course(arrow, condense(arrow, 0.0));
    BlockSet set;
    Latents latents(1);
    for (std::size_t b = 0; b < problem.block.size(); ++b) {
        ActiveBlock& block = set.blocks.emplace_back();
        block.block = b;
        block.latents = l;
        latents[0].emplace_back(Eigen::VectorXd::Constant(l, 1.0));
    }
    const Eigen::Vector3d d(0.5, -2.0, 1.0);
    course.follow(d, set, latents);
    const double size = exact.lpNorm<Eigen::Infinity>();
    for (std::size_t b = 0; b < problem.block.size(); ++b) {
        const auto own = exact.middleRows(problem.offset(b), l);
        for (Eigen::Index j = 0; j < l; ++j)
            CHECK_THAT(latents[0][b][j], WithinAbs(1.0 + own.row(j).dot(d), 1e-12 * size));
        for (Eigen::Index i = 0; i < q; ++i)
            CHECK((course.along(i)[b] - own.col(i)).lpNorm<Eigen::Infinity>() < 1e-12 * size);
    }
}

}  // namespace orbid::tests::latent_course_test

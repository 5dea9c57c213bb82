#include "estimator/algebra/subspace.hpp"

#include <Eigen/LU>
#include <Eigen/QR>

#include "estimator/problem/bounded_step.hpp"
#include "estimator/uncertainty/identifiability.hpp"
#include "tests/catch.hpp"

namespace orbid::tests::subspace_test {

TEST_CASE("full rank is the same with singular values and without", "[estimator]") {
    // A triangle is judged by its inverse, the same rows rotated by their singular values.
    const Eigen::Vector3d size(1.0, 1e-3, 50.0);
    Eigen::Matrix3d r;
    r << 300.0, 2e5, 4.0, 0.0, 1e5, -3.0, 0.0, 0.0, 0.5;
    const Eigen::Matrix3d rotation =
        Eigen::Matrix3d((Eigen::Matrix3d() << 1.0, 2.0, 3.0, 0.5, -1.0, 0.7, 2.0, 0.1, -1.0).finished())
            .householderQr()
            .householderQ();
    const Eigen::Vector3d rhs(0.3, -2.0, 1.0);
    const Eigen::Vector3d exact = -r.triangularView<Eigen::Upper>().solve(rhs);
    const Eigen::Vector3d variance = (r.transpose() * r).inverse().diagonal();
    for (const bool rotated : {false, true}) {
        CAPTURE(rotated);
        estimator::ReducedProblem problem;
        problem.r = rotated ? Eigen::MatrixXd(rotation * r) : Eigen::MatrixXd(r);
        problem.rhs = rotated ? Eigen::Vector3d(rotation * rhs) : rhs;
        const estimator::PriorModel none{0.0, Eigen::Vector3d::Zero(), {}, Eigen::MatrixXd::Zero(0, 3)};
        const Eigen::Vector3d wide = Eigen::Vector3d::Constant(1e9);
        const auto step = estimator::bounded_step(problem, none, {-wide, wide}, 0.0, size, size, 3e-8);
        CHECK(step.space.data.isIdentity(0.0) == !rotated);
        const auto found = estimator::identifiability(problem.r, step, size, size);
        for (Eigen::Index i = 0; i < 3; ++i) {
            CHECK_THAT(step.d[i], WithinRel(exact[i], 1e-13));
            CHECK_THAT(found.data_variance[i], WithinRel(variance[i], 1e-12));
        }
    }
    // Columns that differ by less than the tolerance: one direction is lost, whatever the shape of the rows.
    Eigen::Matrix3d dependent = r;
    dependent.col(2) = dependent.col(1) / 4e3;
    dependent(2, 2) = 1e-8 * dependent(1, 2);
    for (const Eigen::Matrix3d& rows : {dependent, Eigen::Matrix3d(rotation * dependent)})
        CHECK(estimator::split(rows, Eigen::MatrixXd::Zero(0, 3), size, 3e-8).data.cols() == 2);
}

}  // namespace orbid::tests::subspace_test

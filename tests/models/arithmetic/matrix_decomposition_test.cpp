#include <cmath>
#include <complex>
#include <limits>
#include <numbers>

#include <Eigen/Core>

#include "models/arithmetic/cholesky_factor.hpp"
#include "models/arithmetic/eigenvalues.hpp"
#include "models/arithmetic/lu_factor.hpp"
#include "models/arithmetic/orthogonal_factor.hpp"
#include "models/arithmetic/singular_values.hpp"
#include "models/arithmetic/triangular_solve.hpp"
#include "tests/catch.hpp"

namespace orbid::models::matrix_decomposition_test {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

// Matrices here are of size one to ten with condition numbers below 100: a few hundred roundings.
constexpr double rounding = 1e-13;

bool near(const MatrixXd& a, const MatrixXd& b) {
    return a.rows() == b.rows() && a.cols() == b.cols() && (a - b).cwiseAbs().maxCoeff() < rounding;
}

/// Neither symmetric nor triangular, of full rank: the Hilbert matrix would be too ill-conditioned, so with 2 I added.
MatrixXd full(Index rows, Index cols) {
    MatrixXd a(rows, cols);
    for (Index i = 0; i < rows; ++i)
        for (Index j = 0; j < cols; ++j)
            a(i, j) = std::sin(static_cast<double>(3 * i + 7 * j * j + 1)) + (i == j ? 2.0 : 0.0);
    return a;
}

MatrixXd upper(const MatrixXd& a) {
    return a.topRows(a.cols()).triangularView<Eigen::Upper>();
}

/// Second differences, with eigenvalues 2 - 2 cos(k pi / (n + 1)), k = 1 .. n.
MatrixXd second_differences(Index n) {
    MatrixXd a = 2.0 * MatrixXd::Identity(n, n);
    a.diagonal(1).setConstant(-1.0);
    a.diagonal(-1).setConstant(-1.0);
    return a;
}

}  // namespace

TEST_CASE("triangular solutions undo triangular products, of vectors and of matrices", "[models][fast]") {
    const MatrixXd a = full(5, 5);
    const MatrixXd r = a.triangularView<Eigen::Upper>();
    const MatrixXd l = a.triangularView<Eigen::Lower>();
    const MatrixXd x = full(5, 3);
    const VectorXd v = x.col(1);
    // The other half of `a` is not read.
    MatrixXd b = r * x;
    VectorXd w = r * v;
    solve_upper_in_place(a, b);
    solve_upper_in_place(a, w);
    CHECK(near(b, x));
    CHECK(near(w, v));
    b = r.transpose() * x;
    w = r.transpose() * v;
    solve_transposed_upper_in_place(a, b);
    solve_transposed_upper_in_place(a, w);
    CHECK(near(b, x));
    CHECK(near(w, v));
    b = l * x;
    w = l * v;
    solve_lower_in_place(a, b);
    solve_lower_in_place(a, w);
    CHECK(near(b, x));
    CHECK(near(w, v));
    b = x.transpose() * r;
    divide_by_upper_in_place(b, a);
    CHECK(near(b, x.transpose()));
}

TEST_CASE("a triangular corner of a larger matrix is solved with in place", "[models][fast]") {
    const MatrixXd a = full(6, 6);
    const MatrixXd corner = a.topLeftCorner(4, 4).triangularView<Eigen::Upper>();
    const VectorXd v = VectorXd::LinSpaced(4, 1.0, 2.0);
    VectorXd w = corner * v;
    solve_upper_in_place(a.topLeftCorner(4, 4), w);
    CHECK(near(w, v));
}

TEST_CASE("eigenvalues of second differences are known in closed form", "[models][fast]") {
    const Index n = 7;
    const MatrixXd a = second_differences(n);
    const SymmetricEigen eigen = symmetric_eigen(a);
    const VectorXd alone = symmetric_eigenvalues(a);
    const Eigen::VectorXcd general = eigenvalues(a);
    REQUIRE(eigen.values.size() == n);
    REQUIRE(general.size() == n);
    for (Index k = 0; k < n; ++k) {
        const double expected =
            2.0 - 2.0 * std::cos(static_cast<double>(k + 1) * std::numbers::pi / static_cast<double>(n + 1));
        CHECK_THAT(eigen.values[k], tests::WithinAbs(expected, rounding));
        CHECK_THAT(alone[k], tests::WithinAbs(expected, rounding));
        CHECK((general.array() - expected).abs().minCoeff() < rounding);
    }
    CHECK(near(eigen.vectors * eigen.values.asDiagonal() * eigen.vectors.transpose(), a));
    CHECK(near(eigen.vectors.transpose() * eigen.vectors, MatrixXd::Identity(n, n)));
}

TEST_CASE("the upper half of a symmetric matrix is not read", "[models][fast]") {
    MatrixXd a = second_differences(4);
    a.triangularView<Eigen::StrictlyUpper>().setConstant(std::numeric_limits<double>::quiet_NaN());
    CHECK(near(symmetric_eigenvalues(a), symmetric_eigenvalues(second_differences(4))));
    CHECK(CholeskyFactor(a).positive_definite());
    CHECK(near(CholeskyFactor(a).lower(), CholeskyFactor(second_differences(4)).lower()));
}

TEST_CASE("a rotation has complex eigenvalues in conjugate pairs", "[models][fast]") {
    MatrixXd turn(2, 2);
    turn << std::cos(0.3), -std::sin(0.3), std::sin(0.3), std::cos(0.3);
    const Eigen::VectorXcd values = eigenvalues(turn);
    CHECK(std::abs(values[0] - std::polar(1.0, 0.3)) < rounding);
    CHECK(std::abs(values[1] - std::polar(1.0, -0.3)) < rounding);
}

TEST_CASE("a Cholesky factor reconstructs its matrix and solves with it", "[models][fast]") {
    const MatrixXd a = second_differences(5);
    const CholeskyFactor factor(a);
    REQUIRE(factor.positive_definite());
    const MatrixXd& lower = factor.lower();
    CHECK(near(lower * lower.transpose(), a));
    CHECK(lower.triangularView<Eigen::StrictlyUpper>().toDenseMatrix().isZero(0.0));
    // Pivots of second differences: L_kk^2 = (k + 2) / (k + 1).
    for (Index k = 0; k < 5; ++k)
        CHECK_THAT(lower(k, k) * lower(k, k),
                   tests::WithinAbs(static_cast<double>(k + 2) / static_cast<double>(k + 1), rounding));
    const MatrixXd x = full(5, 2);
    CHECK(near(factor.solve(a * x), x));
    const VectorXd v = x.col(0);
    VectorXd w = VectorXd::Zero(5);
    factor.add_lower_times(v, w);
    CHECK(near(w, lower * v));
    MatrixXd b = lower * x;
    factor.solve_lower_in_place(w);
    factor.solve_lower_in_place(b);
    CHECK(near(w, v));
    CHECK(near(b, x));
}

TEST_CASE("a Cholesky factor says that a matrix is not positive definite", "[models][fast]") {
    MatrixXd a = MatrixXd::Identity(3, 3);
    a(2, 2) = -1.0;
    CHECK_FALSE(CholeskyFactor(a).positive_definite());
    a(2, 2) = 0.0;
    CHECK_FALSE(CholeskyFactor(a).positive_definite());
}

TEST_CASE("an LDL^T factor solves with indefinite matrices and knows their signs", "[models][fast]") {
    MatrixXd a = second_differences(4) - 0.5 * MatrixXd::Identity(4, 4);  // eigenvalues 1.5 - 2 cos(k pi / 5): one < 0
    const LdltFactor indefinite(a);
    CHECK(indefinite.succeeded());
    CHECK_FALSE(indefinite.positive_semidefinite());
    CHECK((indefinite.pivots().array() < 0.0).count() == 1);
    const MatrixXd x = full(4, 2);
    const VectorXd v = x.col(1);
    CHECK(near(indefinite.solve(MatrixXd(a * x)), x));
    CHECK(near(indefinite.solve(VectorXd(a * v)), v));
    CHECK(near(indefinite.inverse() * a, MatrixXd::Identity(4, 4)));

    a = second_differences(4);
    const LdltFactor definite(a);
    CHECK(definite.positive_semidefinite());
    CHECK_THAT(definite.pivots().array().log().sum(), tests::WithinAbs(std::log(5.0), rounding));  // |A| = n + 1
    CHECK(near(definite.root() * definite.root().transpose(), a));
    // Of rank one.
    const MatrixXd thin = v * v.transpose();
    const LdltFactor flat(thin);
    CHECK(near(flat.root() * flat.root().transpose(), thin));
}

TEST_CASE("LU factors solve, invert, and give nothing finite for a singular matrix", "[models][fast]") {
    const MatrixXd a = full(5, 5);
    const LuFactor factor(a);
    const MatrixXd x = full(5, 3);
    const VectorXd v = x.col(2);
    CHECK(near(factor.solve(MatrixXd(a * x)), x));
    CHECK(near(factor.solve(VectorXd(a * v)), v));
    CHECK(near(factor.inverse() * a, MatrixXd::Identity(5, 5)));
    CHECK(near(inverse(a) * a, MatrixXd::Identity(5, 5)));
    const MatrixUpTo4 small = full(3, 3);
    CHECK(near(inverse(small) * small, MatrixXd::Identity(3, 3)));
    CHECK_FALSE(LuFactor(MatrixXd::Zero(2, 2)).solve(VectorXd(VectorXd::Ones(2))).allFinite());
}

TEST_CASE("Householder reflections factorise tall matrices", "[models][fast]") {
    const MatrixXd a = full(8, 3);
    HouseholderFactor factor(a);
    const MatrixXd r = upper(factor.packed());
    const MatrixXd q = factor.q();
    REQUIRE(q.rows() == 8);
    REQUIRE(q.cols() == 8);
    CHECK(near(q.transpose() * q, MatrixXd::Identity(8, 8)));
    CHECK(near(q.leftCols(3) * r, a));
    MatrixXd turned = a;
    factor.apply_transposed_q(turned);
    CHECK(near(turned, q.transpose() * a));
    const MatrixXd x = full(3, 2);
    CHECK(near(factor.solve(a * x), x));
    MatrixXd place = a;
    householder_in_place(place);
    CHECK(near(place, factor.packed()));
    // Other numbers in the same memory.
    factor.compute(2.0 * a);
    CHECK(near(upper(factor.packed()), 2.0 * r));
}

TEST_CASE("pivoted QR finds the rank and solves least squares", "[models][fast]") {
    const MatrixXd a = full(8, 3);
    const PivotedFactor factor(a);
    CHECK(factor.rank() == 3);
    // A P = Q R.
    MatrixXd product = MatrixXd::Zero(8, 3);
    product.topRows(3) = upper(factor.packed());
    factor.apply_q(product);
    CHECK(near(product, factor.permuted_back(a.transpose()).transpose()));
    factor.apply_transposed_q(product);
    CHECK(near(product.topRows(3), upper(factor.packed())));
    const MatrixXd x = full(3, 2);
    const VectorXd v = x.col(0);
    CHECK(near(factor.permuted(factor.permuted_back(x)), x));
    CHECK(near(factor.solve(MatrixXd(a * x)), x));
    CHECK(near(factor.solve(VectorXd(a * v)), v));

    MatrixXd dependent(8, 4);
    dependent << a, a.col(0) - 2.0 * a.col(2);
    CHECK(PivotedFactor(dependent).rank() == 3);
    // A column that is a millionth away from the others counts or not.
    dependent(5, 3) += 1e-6;
    CHECK(PivotedFactor(dependent).rank() == 4);
    CHECK(PivotedFactor(dependent, 1e-4).rank() == 3);
}

TEST_CASE("a complete factor gives the shortest of all solutions of least squares", "[models][fast]") {
    // x + y = 2, z free: (1, 1, 0).
    MatrixXd a(1, 3);
    a << 1.0, 1.0, 0.0;
    const CompleteFactor factor(a);
    CHECK(factor.rank() == 1);
    CHECK(near(factor.solve(VectorXd(VectorXd::Constant(1, 2.0))), Eigen::Vector3d(1.0, 1.0, 0.0)));
    CHECK(near(factor.solve(MatrixXd(MatrixXd::Constant(1, 2, 2.0))), Eigen::Vector3d(1.0, 1.0, 0.0).replicate(1, 2)));
    CHECK(near(factor.pseudo_inverse(), Eigen::Vector3d(0.5, 0.5, 0.0)));

    // |A^+T g| by the factors: the row space part of g, through T.
    MatrixXd dependent(6, 3);
    dependent << full(6, 2), full(6, 2).rowwise().sum();
    CompleteFactor other;
    other.compute(dependent, 1e-8);
    REQUIRE(other.rank() == 2);
    const VectorXd g = Eigen::Vector3d(1.0, -2.0, 0.5);
    const VectorXd coordinates = other.row_space_coordinates(g);
    CHECK_THAT(coordinates.norm(), tests::WithinAbs(g.norm(), rounding));
    VectorXd known = coordinates.head(2);
    other.solve_transposed_t_in_place(known);
    CHECK_THAT(known.norm(), tests::WithinAbs((other.pseudo_inverse().transpose() * g).norm(), rounding));
    // Of full rank all of g lies in the row space.
    other.compute(full(6, 3), 1e-8);
    REQUIRE(other.rank() == 3);
    known = other.row_space_coordinates(g);
    other.solve_transposed_t_in_place(known);
    CHECK_THAT(known.norm(), tests::WithinAbs((other.pseudo_inverse().transpose() * g).norm(), rounding));
}

TEST_CASE("singular values of a product of known factors come back", "[models][fast]") {
    const MatrixXd u = HouseholderFactor(full(6, 6)).q();
    const MatrixXd v = HouseholderFactor(full(3, 3)).q();
    const VectorXd values = Eigen::Vector3d(5.0, 2.0, 0.25);
    const MatrixXd a = u.leftCols(3) * values.asDiagonal() * v.transpose();
    CHECK(near(singular_values(a), values));
    const SingularValues thin = singular_value_decomposition(a, SingularVectors::thin);
    CHECK(near(thin.values, values));
    CHECK(near(thin.u * thin.values.asDiagonal() * thin.v.transpose(), a));
    const SingularValues whole = singular_value_decomposition(a, SingularVectors::full);
    REQUIRE(whole.u.cols() == 6);
    CHECK(near(whole.u.transpose() * whole.u, MatrixXd::Identity(6, 6)));
    CHECK(near(whole.u.leftCols(3) * whole.values.asDiagonal() * whole.v.transpose(), a));
    const SingularValues right = singular_value_decomposition(a.transpose(), SingularVectors::right);
    CHECK(right.u.size() == 0);
    REQUIRE(right.v.rows() == 6);
    REQUIRE(right.v.cols() == 6);
    CHECK((a.transpose() * right.v.rightCols(3)).norm() < rounding);
}

}  // namespace orbid::models::matrix_decomposition_test

#include "estimator/algebra/r_factor.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "tests/catch.hpp"

namespace r_factor_test {

using namespace orbid::estimator;
using orbid::tests::WithinAbs;

namespace {

Eigen::MatrixXd random_rows(Eigen::Index rows, Eigen::Index columns) {
    std::mt19937_64 generator(7);
    std::normal_distribution<double> normal;
    Eigen::MatrixXd a(rows, columns);
    for (double& entry : a.reshaped())
        entry = normal(generator);
    return a;
}

/// Largest difference of R^T R and A^T A, relative to the lengths of the columns; both in extended precision.
double worst_product(const Eigen::MatrixXd& a, const Eigen::MatrixXd& r) {
    using Extended = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
    const Extended wide = a.cast<long double>();
    const Extended factor = r.cast<long double>();
    const Extended difference = factor.transpose() * factor - wide.transpose() * wide;
    double worst = 0.0;
    for (Eigen::Index i = 0; i < a.cols(); ++i)
        for (Eigen::Index j = 0; j < a.cols(); ++j)
            worst =
                std::max(worst, std::abs(static_cast<double>(difference(i, j))) / (a.col(i).norm() * a.col(j).norm()));
    return worst;
}

}  // namespace

TEST_CASE("an R factor keeps all products of columns, whatever the shape of the rows", "[estimator][algebra]") {
    // On both sides of where panels are reflected by plain loops (256 entries) and where they are divided.
    for (const Eigen::Index rows : {1, 2, 3, 7, 20, 50, 52, 200, 3000})
        for (const Eigen::Index columns : {1, 2, 5}) {
            CAPTURE(rows, columns);
            const Eigen::MatrixXd a = random_rows(rows, columns);
            const Eigen::MatrixXd r = upper_triangle(a);
            REQUIRE(r.rows() == columns);
            REQUIRE(r.cols() == columns);
            CHECK(r.isUpperTriangular(0.0));
            // Reflections err by a few roundings per column; 3000 rows stay below 1e-14.
            CHECK_THAT(worst_product(a, r), WithinAbs(0.0, 1e-14));
        }
}

TEST_CASE("an R factor of few rows: exact values, zero columns and light rows", "[estimator][algebra]") {
    // Columns (3, 4) and (1, 2): R = (5, 11/5; 0, 2/5) but for signs of rows.
    const Eigen::MatrixXd plain = upper_triangle((Eigen::MatrixXd(2, 2) << 3.0, 1.0, 4.0, 2.0).finished());
    CHECK_THAT(std::abs(plain(0, 0)), WithinAbs(5.0, 1e-14));
    CHECK_THAT(plain(0, 1) * plain(0, 0), WithinAbs(11.0, 1e-13));
    CHECK_THAT(std::abs(plain(1, 1)), WithinAbs(0.4, 1e-14));
    CHECK(upper_triangle(Eigen::MatrixXd::Zero(4, 3)).isZero(0.0));

    // A row of weight 1e10 and light ones: the light ones alone decide the second diagonal, sqrt(1 + 4) for the part of
    // (1, 2) that is independent of the heavy row.
    Eigen::MatrixXd weighted = Eigen::MatrixXd::Zero(3, 2);
    weighted << 0.0, 1.0, 0.0, 2.0, 1e10, 1e10;
    const Eigen::MatrixXd r = upper_triangle(weighted);
    CHECK_THAT(std::abs(r(1, 1)), WithinAbs(std::sqrt(5.0), 1e-14));

    // What is not finite stays visible.
    Eigen::MatrixXd broken = random_rows(4, 2);
    broken(2, 0) = std::numeric_limits<double>::quiet_NaN();
    CHECK(!upper_triangle(broken).allFinite());
}

TEST_CASE("columns whose squares are below the range of a double do no harm", "[estimator][algebra]") {
    // Chains that contract leave such columns between nodes that lie far from each other.
    for (const double size : {1e-150, 1e-155, 1e-160, 1e-165, 1e-200, 1e-310}) {
        CAPTURE(size);
        Eigen::MatrixXd a = random_rows(4, 3);
        a.leftCols(2) *= size;
        CHECK(upper_triangle(a).allFinite());
        const Eigen::VectorXd before = a.col(2);
        const std::array<double, 2> limit{0.0, 0.0};
        std::array<Eigen::Index, 2> order{};
        eliminate(a, 0, 0, limit.data(), 2, order.data());
        CHECK(a.allFinite());
        CHECK_THAT(a.col(2).norm(), WithinAbs(before.norm(), 1e-14));
    }
}

}  // namespace r_factor_test

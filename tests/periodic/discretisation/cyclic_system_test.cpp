#include "periodic/discretisation/cyclic_system.hpp"

#include <cmath>
#include <vector>

#include <Eigen/Dense>

#include "tests/catch.hpp"
#include "tests/periodic/orbit/scattered.hpp"

namespace cyclic_system_test {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using orbid::periodic::CyclicSystem;
using orbid::tests::scattered;

namespace {

MatrixXd dense(const std::vector<MatrixXd>& factors) {
    const auto p = static_cast<Index>(factors.size());
    const Index n = factors[0].rows();
    MatrixXd a = MatrixXd::Zero(n * p, n * p);
    for (Index j = 0; j < p; ++j) {
        a.block(n * j, n * ((j + 1) % p), n, n) += MatrixXd::Identity(n, n);
        a.block(n * j, n * j, n, n) -= factors[static_cast<std::size_t>(j)];
    }
    return a;
}

}  // namespace

TEST_CASE("cyclic system is solved as the dense matrix is", "[periodic]") {
    for (const Index p : {1, 2, 3, 4, 7}) {
        CAPTURE(p);
        std::vector<MatrixXd> factors;
        for (Index j = 0; j < p; ++j)
            factors.push_back(3.0 * scattered(3, 3, 0.1 + static_cast<double>(j)));
        const MatrixXd b = scattered(3 * p, 2, 0.7);
        const CyclicSystem system(factors);
        REQUIRE_FALSE(system.singular());
        const MatrixXd expected = dense(factors).fullPivLu().solve(b);
        // Both are backward stable; condition numbers here are below 1e3: 1e3 x 1e-16 x 10.
        CHECK((system.solve(b) - expected).cwiseAbs().maxCoeff() < 1e-12 * (1.0 + expected.cwiseAbs().maxCoeff()));
    }
}

TEST_CASE("bordered cyclic system is solved as the dense matrix is, also where the cyclic part is singular",
          "[periodic]") {
    for (const Index p : {1, 2, 3, 6}) {
        CAPTURE(p);
        // x_{j+1} = X_j x_j with X_{p-1} .. X_0 (1, 1, 1) = (1, 1, 1): singular, as for an autonomous orbit.
        std::vector<MatrixXd> factors;
        for (Index j = 0; j < p; ++j) {
            MatrixXd factor = scattered(3, 3, 0.1 + static_cast<double>(j));
            factor.col(2) = Eigen::Vector3d::Ones() - factor.col(0) - factor.col(1);
            factors.push_back(factor);
        }
        CHECK(CyclicSystem(factors).singular());
        for (const Index k : {1, 2})
            for (const Index reach : {Index{3}, 3 * p}) {  // conditions on the first node alone, and on all
                if (k == 2 && reach == 3) continue;
                CAPTURE(k, reach);
                const CyclicSystem::Border border{scattered(3 * p, k, 0.4), scattered(k, reach, 0.6),
                                                  scattered(k, k, 0.9)};
                const CyclicSystem system(factors, border);
                REQUIRE_FALSE(system.singular());
                MatrixXd whole = MatrixXd::Zero(3 * p + k, 3 * p + k);
                whole.topLeftCorner(3 * p, 3 * p) = dense(factors);
                whole.topRightCorner(3 * p, k) = -border.columns;
                whole.bottomLeftCorner(k, reach) = border.rows;
                whole.bottomRightCorner(k, k) = border.corner;
                const MatrixXd b = scattered(3 * p + k, 2, 0.7);
                const MatrixXd expected = whole.fullPivLu().solve(b);
                // Both are backward stable; condition numbers here are below 200: 1e3 x 1e-16 x 10 is enough.
                CHECK((system.solve(b) - expected).cwiseAbs().maxCoeff() <
                      1e-12 * (1.0 + expected.cwiseAbs().maxCoeff()));
                CHECK_THROWS_AS(CyclicSystem(factors, {MatrixXd::Ones(2, k), border.rows, border.corner}),
                                std::invalid_argument);
                CHECK_THROWS_AS(CyclicSystem(factors, {border.columns, MatrixXd::Ones(k, 2), border.corner}),
                                std::invalid_argument);
            }
    }
}

TEST_CASE("null vector of a cyclic system that is singular to the last bit, or but for rounding", "[periodic]") {
    for (const Index p : {1, 2, 3, 6})
        for (const double offset : {0.0, 1e-16, 1e-13, -1e-13}) {
            CAPTURE(p, offset);
            // The product maps (3, 1) to itself, without rounding.
            std::vector<MatrixXd> factors(1, MatrixXd(2, 2));
            factors[0] << 2.0, -3.0, 0.5, -0.5;
            for (Index j = 1; j < p; ++j)
                factors.push_back((j % 2 == 0 ? 0.5 : j + 1 < p ? 2.0 : 1.0) * MatrixXd::Identity(2, 2));
            factors.front() *= 1.0 + offset;
            const VectorXd null = CyclicSystem(factors).null_vector();
            REQUIRE(null.allFinite());
            CHECK_THAT(null.norm(), orbid::tests::WithinAbs(1.0, 1e-15));
            CHECK((dense(factors) * null).norm() < 1e-12);
            CHECK_THAT(null(0) / null(1), orbid::tests::WithinAbs(3.0, 1e-11));
        }
}

TEST_CASE("units of coordinates change nothing of a bordered cyclic system but units", "[periodic]") {
    const Index n = 3, p = 4;
    std::vector<MatrixXd> factors, scaled;
    const Eigen::Vector3d unit(std::ldexp(1.0, -300), 1.0, std::ldexp(1.0, 90));
    for (Index j = 0; j < p; ++j) {
        factors.push_back(scattered(n, n, 0.1 + static_cast<double>(j)));
        scaled.push_back(unit.asDiagonal() * factors.back() * unit.cwiseInverse().asDiagonal());
    }
    const CyclicSystem::Border border{scattered(n * p, 1, 0.4), scattered(1, n * p, 0.6), scattered(1, 1, 0.9)};
    CyclicSystem::Border beside = border;
    const MatrixXd b = scattered(n * p + 1, 2, 0.7);
    const VectorXd units = unit.replicate(p, 1);
    const double row = std::ldexp(1.0, 200);
    beside.columns = units.asDiagonal() * border.columns;
    beside.rows = row * border.rows * units.cwiseInverse().asDiagonal();
    beside.corner *= row;
    MatrixXd right = b;
    right.topRows(n * p) = units.asDiagonal() * b.topRows(n * p);
    right.bottomRows(1) *= row;
    const CyclicSystem plain(factors, border);
    const CyclicSystem other(scaled, beside, 1.5 * unit);
    CHECK_FALSE(other.singular());
    MatrixXd expected = plain.solve(b);
    expected.topRows(n * p) = units.asDiagonal() * expected.topRows(n * p);
    CHECK(other.solve(right) == expected);
    VectorXd null = plain.null_vector();
    null.head(n * p).array() *= units.array();
    CHECK(other.null_vector() == null);
    // By the entries alone it would be judged singular.
    CHECK(CyclicSystem(scaled, beside).singular());
    for (const VectorXd& wrong : {VectorXd(VectorXd::Ones(2)), VectorXd(VectorXd::Zero(3))})
        CHECK_THROWS_AS(CyclicSystem(factors, border, wrong), std::invalid_argument);
}

TEST_CASE("cyclic system keeps its digits where the product of the factors loses them all", "[periodic]") {
    // x_{j+1} = diag(8, 1/8) rotated by 0.3, 40 times: the product grows like 1e36 while the condition of the cyclic
    // matrix stays near 10, because every single step is hyperbolic.
    const Index p = 40;
    const Eigen::Rotation2Dd turn(0.3);
    const MatrixXd factor =
        turn.toRotationMatrix() * Eigen::Vector2d(8.0, 0.125).asDiagonal() * turn.inverse().toRotationMatrix();
    const std::vector<MatrixXd> factors(static_cast<std::size_t>(p), factor);
    const MatrixXd expected = scattered(2 * p, 1, 0.2);
    const MatrixXd b = dense(factors) * expected;
    // Derived: condition ~ 10, eps 2e-16, a growth of sqrt(2 p).
    CHECK((CyclicSystem(factors).solve(b) - expected).cwiseAbs().maxCoeff() < 2e-14);
}

TEST_CASE("a condition on all nodes costs no digits where the cyclic part is singular and grows", "[periodic]") {
    // Forty steps of diag(8, 1/8, 1): the third direction makes the cyclic part singular, as the shift along an
    // autonomous orbit does, and the sum of its entries over all nodes fixes it.
    const Index p = 40;
    const std::vector<MatrixXd> factors(static_cast<std::size_t>(p), Eigen::Vector3d(8.0, 0.125, 1.0).asDiagonal());
    CyclicSystem::Border border{MatrixXd::Zero(3 * p, 1), MatrixXd::Zero(1, 3 * p), MatrixXd::Zero(1, 1)};
    for (Index j = 0; j < p; ++j) {
        border.columns(3 * j + 2, 0) = 1.0;  // tau drives the third entry of every step
        border.rows(0, 3 * j + 2) = 1.0;
    }
    MatrixXd whole = MatrixXd::Zero(3 * p + 1, 3 * p + 1);
    whole.topLeftCorner(3 * p, 3 * p) = dense(factors);
    whole.topRightCorner(3 * p, 1) = -border.columns;
    whole.bottomLeftCorner(1, 3 * p) = border.rows;
    const MatrixXd expected = scattered(3 * p + 1, 1, 0.2);
    const CyclicSystem system(factors, border);
    REQUIRE_FALSE(system.singular());
    // Sums of forty ones: the condition is about p^2 / 4 = 400; eps 2e-16, times ten.
    CHECK((system.solve(whole * expected) - expected).cwiseAbs().maxCoeff() < 1e-12);
}

TEST_CASE("cyclic system says when it is singular", "[periodic]") {
    const MatrixXd identity = MatrixXd::Identity(2, 2);
    CHECK(CyclicSystem({identity}).singular());
    CHECK(CyclicSystem({2.0 * identity, 0.5 * identity}).singular());
    CHECK(CyclicSystem({2.0 * identity, 0.5 * identity, identity, identity}).singular());
    CHECK_FALSE(CyclicSystem({2.0 * identity, 0.6 * identity}).singular());
    CHECK_FALSE(CyclicSystem({MatrixXd::Zero(2, 2), identity}).singular());
}

TEST_CASE("cyclic system refuses factors that do not fit", "[periodic]") {
    CHECK_THROWS_AS(CyclicSystem({}), std::invalid_argument);
    CHECK_THROWS_AS(CyclicSystem({MatrixXd::Zero(2, 3)}), std::invalid_argument);
    CHECK_THROWS_AS(CyclicSystem({MatrixXd::Zero(2, 2), MatrixXd::Zero(3, 3)}), std::invalid_argument);
}

}  // namespace cyclic_system_test

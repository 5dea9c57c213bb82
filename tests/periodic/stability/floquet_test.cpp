#include "periodic/stability/floquet.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Dense>

#include "tests/catch.hpp"
#include "tests/periodic/orbit/scattered.hpp"

namespace floquet_test {

using Eigen::Index;
using Eigen::MatrixXd;
using orbid::periodic::floquet_multipliers;
using orbid::tests::scattered;
using Complex = std::complex<double>;

namespace {

MatrixXd orthogonal(Index n, double seed) {
    return Eigen::HouseholderQR<MatrixXd>(scattered(n, n, seed)).householderQ();
}

/// Factors Q_{j+1} B_j Q_j^T whose product has the eigenvalues of the product of the B_j.
std::vector<MatrixXd> hidden(const std::vector<MatrixXd>& plain) {
    std::vector<MatrixXd> factors;
    const std::size_t p = plain.size();
    const Index n = plain[0].rows();
    for (std::size_t j = 0; j < p; ++j)
        factors.push_back(orthogonal(n, 0.3 + static_cast<double>((j + 1) % p)) * plain[j] *
                          orthogonal(n, 0.3 + static_cast<double>(j)).transpose());
    return factors;
}

}  // namespace

TEST_CASE("multipliers of one factor are its eigenvalues", "[periodic]") {
    MatrixXd companion(3, 3);  // (x - 2)(x^2 + 1)
    companion << 2.0, -1.0, 2.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0;
    const auto values = floquet_multipliers({companion});
    REQUIRE(values.size() == 3);
    // Rounding: n eps x condition of the eigenvalues (below 10).
    CHECK(std::abs(values[0] - 2.0) < 1e-14);
    CHECK(std::abs(values[1] - Complex(0.0, 1.0)) < 1e-14);
    CHECK(values[2] == std::conj(values[1]));
    CHECK(values[0].imag() == 0.0);
}

TEST_CASE("multipliers agree with the eigenvalues of the product where that is well conditioned", "[periodic]") {
    for (const Index n : {2, 3, 5, 8})
        for (const int p : {1, 2, 3, 5}) {
            CAPTURE(n, p);
            std::vector<MatrixXd> factors;
            MatrixXd product = MatrixXd::Identity(n, n);
            for (int j = 0; j < p; ++j) {
                factors.push_back(MatrixXd::Identity(n, n) + 0.3 * scattered(n, n, 0.17 * static_cast<double>(n) + j));
                product = factors.back() * product;
            }
            const Eigen::VectorXcd expected = product.eigenvalues();
            const auto values = floquet_multipliers(factors);
            REQUIRE(values.size() == static_cast<std::size_t>(n));
            for (const Complex& value : values) {
                const double nearest = (expected.array() - value).abs().minCoeff();
                // Worst measured 3e-14 relative to the largest (n = 8, p = 5); ten times that.
                CHECK(nearest < 3e-13 * std::abs(values[0]));
            }
            for (std::size_t i = 1; i < values.size(); ++i)
                CHECK(std::abs(values[i]) <= std::abs(values[i - 1]));
        }
}

TEST_CASE("small multipliers keep their digits beside large ones", "[periodic]") {
    // Upper triangular factors with diagonals (8, 0.5, 1/16): after p = 30 the multipliers are 2^90, 2^-30, 2^-120.
    // The explicit product holds the last one relative to the first with 2^-210 = 1e-63 << eps.
    MatrixXd plain(3, 3);
    plain << 8.0, 1.0, -2.0, 0.0, 0.5, 0.7, 0.0, 0.0, 0.0625;
    const auto values = floquet_multipliers(hidden(std::vector<MatrixXd>(30, plain)));
    REQUIRE(values.size() == 3);
    // Each factor contributes rounding relative to its norm: 30 x 8.5/0.0625 x eps x a few for the smallest.
    CHECK(std::abs(values[0].real() / std::ldexp(1.0, 90) - 1.0) < 1e-13);
    CHECK(std::abs(values[1].real() / std::ldexp(1.0, -30) - 1.0) < 1e-12);
    CHECK(std::abs(values[2].real() / std::ldexp(1.0, -120) - 1.0) < 1e-11);
}

TEST_CASE("complex pairs survive long products", "[periodic]") {
    // 50 rotations by 0.37 scaled by 0.5, beside a direction stretched by 3.
    MatrixXd plain = MatrixXd::Zero(3, 3);
    plain(0, 0) = 3.0;
    plain.bottomRightCorner(2, 2) = 0.5 * Eigen::Rotation2Dd(0.37).toRotationMatrix();
    const auto values = floquet_multipliers(hidden(std::vector<MatrixXd>(50, plain)));
    REQUIRE(values.size() == 3);
    const Complex expected = std::pow(0.5, 50) * std::polar(1.0, 50 * 0.37);
    CHECK(std::abs(values[0].real() / std::pow(3.0, 50) - 1.0) < 1e-12);
    // 50 factors x 6 (norm over modulus) x eps.
    CHECK(std::abs(values[1] - Complex(expected.real(), std::abs(expected.imag()))) < 1e-12 * std::abs(expected));
    CHECK(values[2] == std::conj(values[1]));
}

TEST_CASE("defective and cyclic products converge", "[periodic]") {
    MatrixXd permutation = MatrixXd::Zero(4, 4);  // eigenvalues: the fourth roots of one
    for (Index i = 0; i < 4; ++i)
        permutation(i, (i + 1) % 4) = 1.0;
    const auto roots = floquet_multipliers({permutation});
    REQUIRE(roots.size() == 4);
    for (const Complex& root : roots)
        CHECK(std::abs(root * root * root * root - 1.0) < 1e-13);

    MatrixXd jordan(2, 2);
    jordan << 1.0, 1.0, 0.0, 1.0;
    for (const Complex& value : floquet_multipliers(hidden({jordan, jordan, jordan})))
        CHECK(std::abs(value - 1.0) < 1e-7);  // sqrt(eps): the eigenvalue is defective
}

TEST_CASE("a period that sticks gives a multiplier of exactly zero", "[periodic]") {
    MatrixXd sticking(2, 2);
    sticking << 0.3, 1.7, 0.0, 0.0;
    const MatrixXd other = scattered(2, 2, 0.4) * 3.0;
    const auto values = floquet_multipliers({other, sticking, other});
    REQUIRE(values.size() == 2);
    CHECK(values[1] == Complex(0.0, 0.0));
    // Rank one: the other one is the trace of the product.
    CHECK(std::abs(values[0].real() - (other * sticking * other).trace()) < 1e-13);
    const auto none = floquet_multipliers({MatrixXd::Zero(2, 2)});
    CHECK(none == std::vector<Complex>{0.0, 0.0});
}

TEST_CASE("multipliers refuse factors that do not fit", "[periodic]") {
    CHECK_THROWS_AS(floquet_multipliers({}), std::invalid_argument);
    CHECK_THROWS_AS(floquet_multipliers({MatrixXd::Zero(2, 3)}), std::invalid_argument);
    CHECK_THROWS_AS(floquet_multipliers({MatrixXd::Zero(2, 2), MatrixXd::Zero(3, 3)}), std::invalid_argument);
    CHECK_THROWS_AS(floquet_multipliers({MatrixXd::Constant(2, 2, std::nan(""))}), std::invalid_argument);
}

TEST_CASE("multipliers of many factors whose growth alternates are found", "[periodic]") {
    // Steps of h = 0.02 of x'' = 30 cos(t / 2) x - 0.2 x': the determinant of each is exp(-0.2 h).
    std::vector<MatrixXd> factors;
    MatrixXd product = MatrixXd::Identity(2, 2);
    const double h = 0.02;
    constexpr int count = 1257;  // two periods of the coefficient
    for (int k = 0; k < count; ++k) {
        MatrixXd kick(2, 2), drift(2, 2);
        kick << 1.0, 0.0, h * 30.0 * std::cos(0.5 * h * k), std::exp(-0.2 * h);
        drift << 1.0, h, 0.0, 1.0;
        factors.push_back(drift * kick);
        product = factors.back() * product;
    }
    const auto values = floquet_multipliers(factors);
    REQUIRE(values.size() == 2);
    // The large one is the trace but for the small one; the product rounds 1257 times.
    CHECK_THAT(values[0].real(), orbid::tests::WithinRel(product.trace(), 1e-11));
    CHECK_THAT(values[1].real() * values[0].real(), orbid::tests::WithinRel(std::exp(-0.2 * h * count), 1e-3));
}

}  // namespace floquet_test

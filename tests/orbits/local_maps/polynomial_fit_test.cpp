#include "orbits/local_maps/polynomial_fit.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <random>

#include "tests/catch.hpp"

namespace polynomial_fit_test {

using namespace orbid;
using orbits::Monomials;
using orbits::PolynomialFit;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

// Places in the unit ball, nearest first.
Eigen::MatrixXd places(Eigen::Index k, Eigen::Index n, std::uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    std::vector<Eigen::VectorXd> all;
    while (static_cast<Eigen::Index>(all.size()) < k) {
        const Eigen::VectorXd x = Eigen::VectorXd::NullaryExpr(n, [&] { return uniform(random); });
        if (x.norm() < 1.0) all.push_back(x);
    }
    std::sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.norm() < b.norm(); });
    Eigen::MatrixXd result(k, n);
    for (Eigen::Index i = 0; i < k; ++i)
        result.row(i) = all[static_cast<std::size_t>(i)].transpose();
    return result;
}

}  // namespace

TEST_CASE("monomials come by order, and their derivatives are those of differences", "[orbits][polynomial]") {
    const Monomials three(3, 4);
    CHECK(three.count(0) == 1);
    CHECK(three.count(2) == 10);
    CHECK(three.count(4) == 35);
    CHECK(orbits::coefficient_count(3, 4) == 35);
    const std::array<double, 3> t{0.3, -0.7, 1.1};
    std::vector<double> values(35), above(35), below(35);
    three.evaluate(t.data(), 35, values.data());
    // 1, t0, t1, t2, t0 t0, t0 t1, t0 t2, t1 t1, t1 t2, t2 t2
    const std::vector<double> expected{1.0, 0.3, -0.7, 1.1, 0.09, -0.21, 0.33, 0.49, -0.77, 1.21};
    for (std::size_t i = 0; i < expected.size(); ++i)
        CHECK_THAT(values[i], WithinAbs(expected[i], 1e-15));
    for (Eigen::Index d = 0; d < 3; ++d) {
        constexpr double h = 1e-5;
        auto moved = t;
        moved[static_cast<std::size_t>(d)] += h;
        three.evaluate(moved.data(), 35, above.data());
        moved[static_cast<std::size_t>(d)] -= 2.0 * h;
        three.evaluate(moved.data(), 35, below.data());
        for (Eigen::Index i = 0; i < 35; ++i) {
            const auto at = static_cast<std::size_t>(i);
            const double slope = three.exponent(i, d) * values[static_cast<std::size_t>(three.lowered(i, d))];
            // third derivative (at most 24) times h^2 / 6, and rounding over h
            CHECK_THAT(slope, WithinAbs((above[at] - below[at]) / (2.0 * h), 1e-9));
        }
    }
}

TEST_CASE("polynomials of the order are reproduced, in one to three dimensions", "[orbits][polynomial]") {
    for (const Eigen::Index n : {1, 2, 3})
        for (int order = 1; order <= 6; ++order) {
            CAPTURE(n, order);
            const Monomials monomials(n, order);
            const Eigen::Index count = monomials.count(order), k = 3 * count + 8;
            const Eigen::MatrixXd offsets = 0.02 * places(k, n, 5);
            const Eigen::MatrixXd truth = Eigen::MatrixXd::Random(count, 2);
            Eigen::MatrixXd columns(k, count);
            const Eigen::MatrixXd scaled = offsets / 0.021;
            monomials.evaluate_columns(scaled.data(), k, count, columns.data());
            PolynomialFit fit;
            REQUIRE(fit.fit(monomials, order, offsets, columns * truth, k, 0.021));
            // rounding times the condition of the design, 1e4 at order 6; measured 1e-13 at worst
            CHECK((fit.coefficients() - truth).cwiseAbs().maxCoeff() < 1e-12);
            CHECK(fit.left_out() < 1e-12);
        }
}

TEST_CASE("leave-one-out and leverage are those of leaving out and of changing rows", "[orbits][polynomial]") {
    const Monomials monomials(2, 4);
    const Eigen::Index k = 20;
    const Eigen::MatrixXd offsets = places(k, 2, 7);
    std::mt19937_64 random(3);
    std::normal_distribution<double> normal;
    const Eigen::MatrixXd values = Eigen::MatrixXd::NullaryExpr(k, 1, [&] { return normal(random); });
    constexpr double radius = 1.1;
    PolynomialFit fit;
    REQUIRE(fit.fit(monomials, 2, offsets, values, k, radius));
    const double value = fit.coefficients()(0, 0), left_out = fit.left_out(), leverage = fit.leverage();

    double squares = 0.0, total = 0.0, changes = 0.0;
    for (Eigen::Index i = 0; i < k; ++i) {
        Eigen::MatrixXd places_left(k - 1, 2), values_left(k - 1, 1);
        for (Eigen::Index j = 0, to = 0; j < k; ++j)
            if (j != i) {
                places_left.row(to) = offsets.row(j);
                values_left.row(to++) = values.row(j);
            }
        PolynomialFit without;
        REQUIRE(without.fit(monomials, 2, places_left, values_left, k - 1, radius));
        std::array<double, 6> terms{};
        const Eigen::Vector2d t = offsets.row(i).transpose() / radius;
        monomials.evaluate(t.data(), 6, terms.data());
        const double predicted = Eigen::Map<const Eigen::VectorXd>(terms.data(), 6).dot(without.coefficients().col(0));
        const double weight = std::pow(1.0 - t.squaredNorm(), 2);
        squares += weight * std::pow(values(i, 0) - predicted, 2);
        total += weight;

        Eigen::MatrixXd changed = values;
        changed(i, 0) += 1.0;
        PolynomialFit other;
        REQUIRE(other.fit(monomials, 2, offsets, changed, k, radius));
        changes += std::pow(other.coefficients()(0, 0) - value, 2);
    }
    CHECK_THAT(left_out, WithinRel(std::sqrt(squares / total), 1e-10));
    CHECK_THAT(leverage, WithinRel(changes, 1e-10));
}

TEST_CASE("independent errors and a smooth remainder are told apart", "[orbits][polynomial]") {
    // Order 2 on 60 rows; remainder: cubic with random coefficients of size a. Over 400 draws the estimates' means are
    // those put in; the error of the value is the one predicted.
    const Monomials monomials(2, 4);
    std::mt19937_64 random(9);
    std::normal_distribution<double> normal;
    for (const auto& [sd, cubic] : {std::pair{1e-3, 0.0}, std::pair{0.0, 1e-2}, std::pair{1e-3, 1e-2}}) {
        CAPTURE(sd, cubic);
        double independent = 0.0, remainder = 0.0, z2 = 0.0;
        constexpr int draws = 400;
        for (int draw = 0; draw < draws; ++draw) {
            const Eigen::MatrixXd offsets = places(60, 2, 100 + static_cast<std::uint64_t>(draw));
            Eigen::MatrixXd columns(60, 10);
            monomials.evaluate_columns(offsets.data(), 60, 10, columns.data());
            Eigen::VectorXd c = Eigen::VectorXd::Zero(10);
            c[0] = 0.7;
            for (Eigen::Index i = 6; i < 10; ++i)
                c[i] = cubic * normal(random);
            Eigen::MatrixXd values = columns * c;
            for (Eigen::Index i = 0; i < 60; ++i)
                values(i, 0) += sd * normal(random);
            PolynomialFit fit;
            REQUIRE(fit.fit(monomials, 2, offsets, values, 60, 1.02));
            fit.part_residuals(monomials);
            independent += fit.independent()(0, 0) / draws;
            remainder += fit.remainder()(0, 0) / draws;
            z2 += std::pow(fit.coefficients()(0, 0) - 0.7, 2) / fit.value_variance() / draws;
        }
        // Means of 400 draws with some ten degrees of freedom each: known to 2-3 %.
        if (sd > 0.0) CHECK_THAT(independent, WithinRel(sd * sd, 0.15));
        if (sd == 0.0) CHECK(independent < 1e-8 * cubic * cubic);
        // The fourth order is there in the model, not in the truth: the estimate spreads what is left over both.
        if (cubic > 0.0) CHECK_THAT(remainder, WithinRel(cubic * cubic, 0.4));
        INFO("error / predicted, rms " << std::sqrt(z2));
        CHECK(std::sqrt(z2) > 0.5);
        CHECK(std::sqrt(z2) < 1.3);
    }
}

TEST_CASE("fits that rows do not carry are refused", "[orbits][polynomial]") {
    const Monomials monomials(2, 2);
    const Eigen::MatrixXd offsets = places(30, 2, 1);
    const Eigen::MatrixXd values = offsets.col(0);
    PolynomialFit fit;
    CHECK_FALSE(fit.fit(monomials, 2, offsets, values, 7, 1.1));
    CHECK(fit.fit(monomials, 2, offsets, values, 8, 1.1));
    CHECK_FALSE(fit.fit(monomials, 2, offsets, values, 30, 0.0));
    Eigen::MatrixXd line = offsets;
    line.col(1) = 0.5 * line.col(0);
    CHECK_FALSE(fit.fit(monomials, 1, line, values, 30, 1.5));
}

}  // namespace polynomial_fit_test

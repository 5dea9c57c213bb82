#pragma once

#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include <Eigen/LU>

#include "estimator/estimate/estimate.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

/// A random walk read with errors, and its exact likelihood.
namespace orbid::tests {

inline constexpr Eigen::Index points = 200;

/// y_i = z_i + s_r e_i,  z_i = z_{i-1} + s_m w_i,  z_0 = mu,  i = 1..n.
inline Eigen::VectorXd made_walk() {
    std::mt19937_64 generator(11);
    std::normal_distribution<double> normal;
    constexpr double reading = 0.3;
    constexpr double matching = 0.1;
    Eigen::VectorXd y(points);
    double z = 2.0;
    for (Eigen::Index i = 0; i < points; ++i) {
        z += matching * normal(generator);
        y[i] = z + reading * normal(generator);
    }
    return y;
}

/// The exact likelihood of (mu, ln s_r, ln s_m): y is normal with mean mu and covariance s_r^2 I + s_m^2 K,
/// K_ij = min(i, j). K^-1 is the second difference with a free end, whose eigenvectors are sines:
///
///     q_k(i) = 2 / sqrt(2 n + 1) sin(a_k i),  1 / lambda_k = 4 sin^2(a_k / 2),  a_k = (2 k - 1) pi / (2 n + 1)
struct ExactWalk {
    Eigen::ArrayXd lambda{points};
    Eigen::ArrayXd u{points};    ///< q_k^T y
    Eigen::ArrayXd one{points};  ///< q_k^T 1

    explicit ExactWalk(const Eigen::VectorXd& y) {
        for (Eigen::Index k = 0; k < points; ++k) {
            const double a = static_cast<double>(2 * k + 1) * std::numbers::pi / static_cast<double>(2 * points + 1);
            Eigen::VectorXd q(points);
            for (Eigen::Index i = 0; i < points; ++i)
                q[i] = 2.0 / std::sqrt(2.0 * points + 1.0) * std::sin(a * static_cast<double>(i + 1));
            lambda[k] = 0.25 / std::pow(std::sin(0.5 * a), 2);
            u[k] = q.dot(y);
            one[k] = q.sum();
            // K q = lambda q, row by row.
            if (k % 40 == 0)
                for (Eigen::Index i = 0; i < points; i += 33) {
                    double sum = 0.0;
                    for (Eigen::Index j = 0; j < points; ++j)
                        sum += static_cast<double>(std::min(i, j) + 1) * q[j];
                    REQUIRE_THAT(sum, WithinAbs(lambda[k] * q[i], 1e-9));
                }
        }
    }

    struct Point {
        double value;  ///< -ln likelihood at its best mu
        double mu;
        double mu_sd;
        Eigen::Vector2d gradient;
    };
    [[nodiscard]] Point at(const Eigen::Vector2d& psi) const {
        const double r2 = std::exp(2.0 * psi[0]);
        const double m2 = std::exp(2.0 * psi[1]);
        const Eigen::ArrayXd v = r2 + m2 * lambda;
        const double weight = (one.square() / v).sum();
        const double mu = (one * u / v).sum() / weight;
        const Eigen::ArrayXd t = (u - mu * one).square() / v;
        Point point{};
        point.value = 0.5 * (v.log() + t).sum() + 0.5 * points * std::log(2.0 * std::numbers::pi);
        point.mu = mu;
        point.mu_sd = 1.0 / std::sqrt(weight);
        point.gradient = {((1.0 - t) * r2 / v).sum(), ((1.0 - t) * m2 * lambda / v).sum()};
        return point;
    }
    [[nodiscard]] Eigen::Matrix2d hessian(const Eigen::Vector2d& psi) const {
        constexpr double h = 1e-5;  // the error of central differences, h^2, is 1e-10
        Eigen::Matrix2d result;
        for (int i = 0; i < 2; ++i)
            result.col(i) =
                (at(psi + h * Eigen::Vector2d::Unit(i)).gradient - at(psi - h * Eigen::Vector2d::Unit(i)).gradient) /
                (2.0 * h);
        return 0.5 * (result + result.transpose());
    }
    [[nodiscard]] Eigen::Vector2d maximum() const {
        Eigen::Vector2d psi(std::log(0.3), std::log(0.1));
        for (int i = 0; i < 50; ++i)
            psi -= hessian(psi).inverse() * at(psi).gradient;
        REQUIRE(at(psi).gradient.norm() < 1e-9);
        return psi;
    }
};

/// One block with all latent states: the readings, and the steps of the walk as records of their own.
inline FunctionResidual dense_walk(const Eigen::VectorXd& y, const estimator::Group& matching = group("matching", 1.0),
                                   const estimator::Group& reading = group("reading", 1.0)) {
    const Eigen::Index count = y.size();
    FunctionResidual residual;
    residual.add_group(reading);
    residual.add_group(matching);
    auto block = layout("walk", 2 * count);
    for (Eigen::Index i = count; i < 2 * count; ++i)
        block.group[static_cast<std::size_t>(i)] = 1;
    block.latents = count;
    Eigen::MatrixXd z = Eigen::MatrixXd::Zero(2 * count, count);
    Eigen::MatrixXd x = Eigen::MatrixXd::Zero(2 * count, 1);
    Eigen::VectorXd all = Eigen::VectorXd::Zero(2 * count);
    all.head(count) = y;
    z.topRows(count).setIdentity();
    for (Eigen::Index i = 0; i < count; ++i) {
        z(count + i, i) = 1.0;
        if (i > 0) z(count + i, i - 1) = -1.0;
    }
    x(count, 0) = -1.0;
    residual.add_block(block, linear(all, x, z), y);
    return residual;
}

/// mu, both scales and their sds are those of the exact likelihood.
inline void check_against(const ExactWalk& exact, const estimator::Estimate& result) {
    CAPTURE(result.message, result.iterations);
    REQUIRE(result.status == estimator::EstimateStatus::converged);
    const Eigen::Vector2d psi = exact.maximum();
    const ExactWalk::Point best = exact.at(psi);
    const Eigen::Matrix2d covariance = exact.hessian(psi).inverse();
    CHECK_THAT(result.parameters[0].value, WithinRel(best.mu, 1e-8));
    CHECK_THAT(result.parameters[0].sd, WithinRel(best.mu_sd, 1e-8));
    for (std::size_t g = 0; g < 2; ++g) {
        const auto i = static_cast<Eigen::Index>(g);
        const double s = std::exp(psi[i]);
        CHECK_THAT(result.scales[g].value, WithinRel(s, 1e-8));
        CHECK_THAT(result.scales[g].uncertainty, WithinRel(s * std::sqrt(covariance(i, i)), 1e-5));
    }
}

}  // namespace orbid::tests

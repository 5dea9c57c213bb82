#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/residual.hpp"
#include "tests/catch.hpp"

namespace orbid::tests {

/// Largest error of e_theta and e_z, relative to the largest entry of each column, against sixth-order central
/// differences with steps of `share` of each parameter: their truncation is (share)^6, their rounding 1e-12 / share.
inline double derivative_error(const estimator::Residual& residual, const Eigen::VectorXd& theta,
                               std::vector<Eigen::VectorXd> latents, double share) {
    const auto value = residual.evaluate(residual.initial_set(), theta, latents, true);
    double worst = 0.0;
    const auto compare = [&](std::size_t b, const Eigen::VectorXd& exact, const auto& moved, double h) {
        static constexpr double weight[] = {45.0 / 60.0, -9.0 / 60.0, 1.0 / 60.0};
        Eigen::VectorXd difference = Eigen::VectorXd::Zero(exact.size());
        for (int i = 1; i <= 3; ++i) {
            const auto above = moved(i * h);
            const auto below = moved(-i * h);
            REQUIRE(above[b].status == estimator::BlockStatus::ok);
            REQUIRE(below[b].status == estimator::BlockStatus::ok);
            difference += weight[i - 1] * (above[b].e - below[b].e) / h;
        }
        const double size = exact.cwiseAbs().maxCoeff();
        worst = std::max(worst, (difference - exact).cwiseAbs().maxCoeff() / std::max(size, 1e-3));
    };
    for (std::size_t b = 0; b < value.size(); ++b) {
        REQUIRE(value[b].status == estimator::BlockStatus::ok);
        for (Eigen::Index i = 0; i < theta.size(); ++i) {
            const double h = share * std::max(std::abs(theta(i)), 1e-3);
            const auto moved = [&](double step) {
                Eigen::VectorXd other = theta;
                other(i) += step;
                return residual.evaluate(residual.initial_set(), other, latents, false);
            };
            compare(b, value[b].e_theta.col(i), moved, h);
        }
        for (Eigen::Index i = 0; i < latents[b].size(); ++i) {
            const auto moved = [&](double step) {
                std::vector<Eigen::VectorXd> other = latents;
                other[b](i) += step;
                return residual.evaluate(residual.initial_set(), theta, other, false);
            };
            compare(b, value[b].e_z.col(i), moved, share);
        }
    }
    return worst;
}

}  // namespace orbid::tests

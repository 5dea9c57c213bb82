#pragma once

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "models/system/system.hpp"
#include "tests/catch.hpp"

namespace orbid::tests {

/// Worst difference between the sensitivities of a flow and central differences of it, relative to their size.
///
/// @param step  of the differences, for values of size 1. Of fourth order: error step^4 times the fifth derivative,
///              rounding 1e-12 / step.
inline double difference_error(const models::System& system, const Eigen::VectorXd& x0, double phase, double duration,
                               const Eigen::VectorXd& theta, const std::vector<Eigen::Index>& free, models::Clock clock,
                               double step = 1e-4) {
    const std::array<double, 1> durations{duration};
    const auto exact = system.flow_with_sensitivities(x0, phase, durations, theta, free, clock);
    REQUIRE(exact.status == models::FlowStatus::ok);
    const Eigen::Index n = x0.size();
    double worst = 0.0;
    for (Eigen::Index j = 0; j < n + static_cast<Eigen::Index>(free.size()); ++j) {
        const auto at = [&](double ahead) -> Eigen::VectorXd {
            Eigen::VectorXd x = x0, p = theta;
            if (j < n)
                x[j] += ahead;
            else
                p[free[static_cast<std::size_t>(j - n)]] += ahead;
            const auto flow = system.flow(x, phase, durations, p, clock);
            REQUIRE(flow.status == models::FlowStatus::ok);
            REQUIRE(flow.crossings == exact.crossings);
            return flow.states.col(0);
        };
        const double value = j < n ? 1.0 : theta[free[static_cast<std::size_t>(j - n)]];
        const double size = value == 0.0 ? 1.0 : std::abs(value);
        const double h = step * size;
        const Eigen::VectorXd difference = (8.0 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12.0 * h);
        worst = std::max(worst, (difference - exact.sensitivities.col(j)).norm() * size /
                                    (1.0 + exact.sensitivities.col(j).norm() * size));
    }
    return worst;
}

/// The same for second derivatives, against central differences of the sensitivities.
inline double second_difference_error(const models::System& system, const Eigen::VectorXd& x0, double phase,
                                      double duration, const Eigen::VectorXd& theta,
                                      const std::vector<Eigen::Index>& free, models::Clock clock, double step = 1e-4) {
    const std::array<double, 1> durations{duration};
    const auto exact = system.flow_with_second_derivatives(x0, phase, durations, theta, free, clock);
    REQUIRE(exact.status == models::FlowStatus::ok);
    const Eigen::Index n = x0.size(), d = n + static_cast<Eigen::Index>(free.size());
    double worst = 0.0;
    for (Eigen::Index j = 0; j < d; ++j) {
        const auto at = [&](double ahead) -> Eigen::MatrixXd {
            Eigen::VectorXd x = x0, p = theta;
            if (j < n)
                x[j] += ahead;
            else
                p[free[static_cast<std::size_t>(j - n)]] += ahead;
            const auto flow = system.flow_with_sensitivities(x, phase, durations, p, free, clock);
            REQUIRE(flow.status == models::FlowStatus::ok);
            REQUIRE(flow.crossings == exact.crossings);
            return flow.sensitivities;
        };
        const Eigen::MatrixXd difference =
            (8.0 * (at(step) - at(-step)) - (at(2 * step) - at(-2 * step))) / (12.0 * step);
        const Eigen::MatrixXd found = exact.second_derivatives.middleCols(j * d, d);
        const double error = (difference - found).norm() / (1.0 + found.norm());
        if (!(error <= worst)) worst = error;
    }
    return worst;
}

/// Expected values and derivatives, from a closed form in dual arithmetic, against a flow: worst error, derivatives
/// relative to their size.
template <std::size_t N, std::size_t n>
double closed_form_error(const models::FlowResult& flow, Eigen::Index k,
                         const std::array<models::Dual<N>, n>& expected) {
    double worst = 0.0;
    const auto compare = [&worst](double found, double wanted) {
        const double error = std::abs(found - wanted) / (1.0 + std::abs(wanted));
        // nan must not pass.
        if (!(error <= worst)) worst = error;
    };
    for (std::size_t i = 0; i < n; ++i) {
        compare(flow.states(static_cast<Eigen::Index>(i), k), expected[i].value);
        for (std::size_t j = 0; j < N; ++j)
            compare(flow.sensitivities(static_cast<Eigen::Index>(i),
                                       k * static_cast<Eigen::Index>(N) + static_cast<Eigen::Index>(j)),
                    expected[i].partial[j]);
    }
    return worst;
}

}  // namespace orbid::tests

#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <stdexcept>

#include "models/system/system.hpp"

namespace orbid::tests {

/// Largest Lyapunov exponent with its standard error.
struct Exponent {
    double mean;            ///< per unit of the clock
    double standard_error;  ///< from the scatter of `blocks` averages, taken as independent
};

/// Growth of one direction along a trajectory, in `blocks` blocks of `per_block` intervals each, after one block that
/// is left out.
inline Exponent largest_exponent(const models::System& system, Eigen::VectorXd x, const Eigen::VectorXd& theta,
                                 double interval, int blocks, int per_block, models::Clock clock) {
    const std::array<double, 1> duration{interval};
    const bool forced = system.kind() == models::Kind::forced;
    double phase = 0.0;
    Eigen::VectorXd direction = Eigen::VectorXd::Ones(x.size()).normalized();
    double sum = 0.0, sum_of_squares = 0.0;
    for (int b = -1; b < blocks; ++b) {
        double growth = 0.0;
        for (int i = 0; i < per_block; ++i) {
            // A local error of 1e-9 moves to another trajectory of the same attractor: averages do not notice.
            const auto flow = system.flow_with_sensitivities(x, phase, duration, theta, {}, clock,
                                                             {.relative_tolerance = 1e-9, .absolute_tolerance = 1e-9});
            if (flow.status != models::FlowStatus::ok) throw std::runtime_error("the trajectory cannot be continued");
            x = flow.states.col(0);
            if (forced) phase += clock == models::Clock::phase ? interval : 0.0;
            const Eigen::VectorXd image = flow.sensitivities * direction;
            growth += std::log(image.norm());
            direction = image.normalized();
        }
        if (b < 0) continue;
        const double average = growth / (per_block * interval);
        sum += average;
        sum_of_squares += average * average;
    }
    const double mean = sum / blocks;
    return {mean, std::sqrt((sum_of_squares / blocks - mean * mean) / (blocks - 1))};
}

}  // namespace orbid::tests

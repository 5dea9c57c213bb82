#pragma once

#include <Eigen/Dense>
#include <array>
#include <stdexcept>

#include "models/system/system.hpp"

namespace orbid::tests {

/// A closed orbit of an autonomous flow.
struct ClosedOrbit {
    Eigen::VectorXd start;
    double period;
    Eigen::MatrixXd monodromy;
    double step;  ///< of Newton's last correction
};

/// Newton's method on start and period, flow(start, period) = start, with one coordinate of the start held.
inline ClosedOrbit closed_orbit(const models::System& system, const Eigen::VectorXd& theta, Eigen::VectorXd start,
                                double period, Eigen::Index held) {
    const Eigen::Index n = start.size();
    double step = 0.0;
    for (int i = 0;; ++i) {
        const auto flow =
            system.flow_with_sensitivities(start, 0.0, std::array{period}, theta, {}, models::Clock::time);
        if (flow.status != models::FlowStatus::ok) throw std::runtime_error("the orbit cannot be followed");
        // Eight iterations from a good guess: the last ones only stir the rounding.
        if (i == 8) return {start, period, flow.sensitivities, step};
        // The held coordinate makes room for the period.
        Eigen::MatrixXd J = flow.sensitivities - Eigen::MatrixXd::Identity(n, n);
        J.col(held) = system.rhs(flow.states, std::array{0.0}, theta);
        Eigen::VectorXd correction = J.partialPivLu().solve(start - flow.states.col(0));
        step = correction.cwiseAbs().maxCoeff();
        period += correction[held];
        correction[held] = 0.0;
        start += correction;
    }
}

}  // namespace orbid::tests

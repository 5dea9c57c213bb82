#pragma once

#include <Eigen/Dense>

#include <cmath>
#include <fstream>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "models/system/system.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace orbid::tests {

/// Mass matrix at the difference of angles, and the weights of the cosines in the potential.
struct Arms {
    double J1, J2, h, G1, G2;

    explicit Arms(const Eigen::VectorXd& p)
        : J1(p[5] + p[0] * p[2] * p[2] + p[1] * p[4] * p[4]),
          J2(p[6] + p[1] * p[3] * p[3]),
          h(p[1] * p[4] * p[3]),
          G1((p[0] * p[2] + p[1] * p[4]) * p[9]),
          G2(p[1] * p[3] * p[9]) {}

    [[nodiscard]] double energy(const Eigen::Vector4d& x) const {
        return 0.5 * J1 * x[2] * x[2] + 0.5 * J2 * x[3] * x[3] + h * std::cos(x[0] - x[1]) * x[2] * x[3] -
               G1 * std::cos(x[0]) - G2 * std::cos(x[1]);
    }
};

/// Rows t, theta1, theta2, theta1_dot, theta2_dot of every segment of tests/reference/double_pendulum/swing.csv.
inline std::map<int, std::vector<Eigen::Vector<double, 5>>> real_arms() {
    std::ifstream in(orbid::tests::source_folder() + "/tests/reference/double_pendulum/swing.csv");
    std::map<int, std::vector<Eigen::Vector<double, 5>>> segments;
    std::string line;
    std::getline(in, line);
    while (std::getline(in, line)) {
        std::istringstream cells(line);
        std::string cell;
        std::vector<double> row;
        while (std::getline(cells, cell, ','))
            row.push_back(std::stod(cell));
        REQUIRE(row.size() == 6);
        segments[static_cast<int>(row[0])].emplace_back(Eigen::Map<Eigen::Vector<double, 5>>(row.data() + 1));
    }
    REQUIRE(segments.size() == 3);
    return segments;
}

/// Root mean square [rad] of what a model leaves of both angles of a segment when only the state in which it begins is
/// fitted: five steps of Gauss and Newton's method from the first row are enough.
///
/// @param upright  what the readings count from: added to the model's angles
inline double rms_of_angles(const models::System& system, const Eigen::VectorXd& theta, double upright,
                            const std::vector<Eigen::Vector<double, 5>>& rows) {
    std::vector<double> times;
    for (const auto& row : rows)
        times.push_back(row[0]);
    const auto count = static_cast<Eigen::Index>(rows.size());
    Eigen::Vector4d start = rows.front().tail<4>();
    start.head<2>().array() -= upright;
    double rms = 0.0;
    for (int i = 0; i < 6; ++i) {
        const auto flow = system.flow_with_sensitivities(start, 0.0, times, theta, {}, models::Clock::time);
        REQUIRE(flow.status == models::FlowStatus::ok);
        const auto read = system.readings({}, flow.states, std::vector<double>(times.size(), 0.0), theta);
        Eigen::MatrixXd J(2 * count, 4);
        Eigen::VectorXd error(2 * count);
        for (Eigen::Index k = 0; k < count; ++k) {
            error.segment<2>(2 * k) = rows[static_cast<std::size_t>(k)].segment<2>(1) - read.readings.col(k).head<2>();
            error.segment<2>(2 * k).array() -= upright;
            J.middleRows<2>(2 * k) = flow.sensitivity(k, 4).topRows<2>();
        }
        rms = std::sqrt(error.squaredNorm() / static_cast<double>(2 * count));
        start += J.colPivHouseholderQr().solve(error);
    }
    return rms;
}

}  // namespace orbid::tests

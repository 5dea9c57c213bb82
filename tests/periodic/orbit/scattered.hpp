#pragma once

#include <cmath>

#include <Eigen/Core>

namespace orbid::tests {

/// Matrix of deterministic numbers in [-1, 1] without structure: sines of large arguments.
inline Eigen::MatrixXd scattered(Eigen::Index rows, Eigen::Index cols, double seed) {
    Eigen::MatrixXd m(rows, cols);
    for (Eigen::Index j = 0; j < cols; ++j)
        for (Eigen::Index i = 0; i < rows; ++i) {
            const auto row = static_cast<double>(i);
            const auto column = static_cast<double>(j);
            m(i, j) = std::sin(1000.0 * seed + 37.0 * row * row + 91.7 * column + 12.3 * row * column);
        }
    return m;
}

}  // namespace orbid::tests

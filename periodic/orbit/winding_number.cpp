#include "periodic/orbit/winding_number.hpp"

#include <algorithm>
#include <cmath>

#include "periodic/orbit/full_turn.hpp"

namespace orbid::periodic {

std::vector<Index> angle_coordinates(const models::System& system) {
    std::vector<Index> angles;
    for (Index i = 0; i < system.dimension(); ++i)
        if (system.coordinates()[static_cast<std::size_t>(i)].angle) angles.push_back(i);
    return angles;
}

VectorXd default_scale(const models::System& system, const MatrixXd& guess) {
    // A coordinate smaller than this fraction of the others is a rounded zero: its size is meaningless.
    constexpr double rounded_zero = 1e-12;
    VectorXd scale = guess.cwiseAbs().rowwise().maxCoeff();
    // Or of a usual state: an equilibrium at 0 is found as 1e-17 in every coordinate.
    const double largest = std::max(system.state_size(), scale.maxCoeff());
    for (Index i = 0; i < scale.size(); ++i) {
        if (system.coordinates()[static_cast<std::size_t>(i)].angle) {
            scale(i) = full_turn;
        } else if (!(scale(i) > rounded_zero * largest)) {
            scale(i) = system.state_size();
        }
    }
    return scale;
}

MatrixXd winding_numbers(const MatrixXd& error, const std::vector<Index>& angles, std::span<const int> rotation) {
    MatrixXd turns = MatrixXd::Zero(error.rows(), error.cols());
    for (std::size_t a = 0; a < angles.size(); ++a) {
        const Index i = angles[a];
        turns.row(i) = (error.row(i) / full_turn).array().round();
        if (rotation.empty()) continue;
        double missing = rotation[a] - turns.row(i).sum();
        while (missing != 0.0) {
            const double direction = missing > 0.0 ? 1.0 : -1.0;
            Index least_certain = 0;
            (direction * (error.row(i) / full_turn - turns.row(i))).maxCoeff(&least_certain);
            turns(i, least_certain) += direction;
            missing -= direction;
        }
    }
    return turns;
}

std::vector<int> total_rotation(const MatrixXd& turns, const std::vector<Index>& angles) {
    std::vector<int> sums;
    for (const Index i : angles)
        sums.push_back(static_cast<int>(std::lround(turns.row(i).sum())));
    return sums;
}

MatrixXd wrapped_angles(MatrixXd difference, const std::vector<Index>& angles) {
    for (const Index i : angles)
        for (double& angle : difference.row(i).reshaped())
            angle = models::wrapped(angle);
    return difference;
}

MatrixXd begun_later(const MatrixXd& points, Index first) {
    MatrixXd later(points.rows(), points.cols());
    later << points.rightCols(points.cols() - first), points.leftCols(first);
    return later;
}

double relative_size(const MatrixXd& difference, const VectorXd& scale) {
    return (difference.array().colwise() / scale.array()).abs().maxCoeff();
}

int repeats_of(const MatrixXd& points, const std::vector<Index>& angles, const VectorXd& scale, double same) {
    const Index p = points.cols();
    for (Index d = 1; d < p; ++d) {
        if (p % d != 0) continue;
        const MatrixXd difference = wrapped_angles(begun_later(points, d) - points, angles);
        if (relative_size(difference, scale) < same) return static_cast<int>(p / d);
    }
    return 1;
}

}  // namespace orbid::periodic

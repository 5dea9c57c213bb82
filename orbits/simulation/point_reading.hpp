#pragma once

#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "orbits/simulation/section_map.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

/// What a sensor reads at the points of a cycle.
struct PointReadings {
    Eigen::MatrixXd values;                ///< shape (n, p)
    std::vector<Eigen::MatrixXd> by_x;     ///< per point, shape (n, n); empty without derivatives
    std::vector<Eigen::MatrixXd> by_free;  ///< per point, shape (n, f)
};

/// Section points as an instrument reads them: y = sensor(x, phase; theta) + error.
class PointReading {
public:
    /// @throws std::invalid_argument for a sensor that reads formulas, since points of cycles stand for complete
    ///         states; for crossings of a plane read by anything but the plain state.
    PointReading(const SectionMap& map, const models::Sensor& sensor);

    /// Readings of section points, the columns of `states`; empty when they cannot be computed.
    /// @param theta  full parameter vector.
    [[nodiscard]] std::optional<PointReadings> operator()(const Eigen::MatrixXd& states, const Eigen::VectorXd& theta,
                                                          std::span<const Eigen::Index> free, bool derivatives) const;

    /// The states with these readings, by Newton's method started from the readings. A column that does not converge
    /// stays as it was read. Shape (n, p).
    [[nodiscard]] Eigen::MatrixXd states(const Eigen::MatrixXd& readings, const Eigen::VectorXd& theta) const;

private:
    SectionMap map_;
    models::Sensor sensor_;
};

}  // namespace orbid::orbits

#pragma GCC visibility pop

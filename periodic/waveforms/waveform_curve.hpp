#pragma once

#include <optional>
#include <span>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "periodic/orbit/orbit.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

/// Where the phase of a limit cycle is zero: its crossing, near `point`, of the plane through `point` across `normal`.
/// It belongs to a block of data, not to a solution: the meaning of a phase does not change with the parameters.
struct PhaseOrigin {
    Eigen::VectorXd point;   ///< shape (n)
    Eigen::VectorXd normal;  ///< shape (n), not 0
};

/// States of an orbit at places along it, with derivatives when asked for (f = 0 columns otherwise).
struct CurveStates {
    bool simulated = false;         ///< everything else is meaningful only if so
    Eigen::MatrixXd states;         ///< shape (n, m); angles continuous between two points of the orbit only
    Eigen::MatrixXd velocity;       ///< shape (n, m): d state / d place
    Eigen::MatrixXd by_parameters;  ///< shape (n, m f): columns [k f, (k + 1) f) = d state_k / d theta, place fixed
};

/// A solved periodic orbit as a closed curve. The place on it is the phase of the forcing [rad], from the section at
/// phase 0 on, or the time [s] since the orbit's first point (autonomous flows). Between two points it is the flow from
/// the earlier one: errors grow over one period of the forcing, not over p.
class SolvedCurve {
public:
    /// @param orbit    solved at phase 0 with these `theta`, with sensitivities to `free` where derivatives are needed.
    ///                 Everything is kept by reference.
    SolvedCurve(const models::System& system, const Eigen::VectorXd& theta, const PeriodicOrbit& orbit,
                const models::FlowOptions& options)
        : system_(system), theta_(theta), orbit_(orbit), options_(options) {}

    /// 2 pi p, or T.
    [[nodiscard]] double length() const;

    /// @param places  any real numbers; taken modulo the length.
    [[nodiscard]] CurveStates states(std::span<const double> places,
                                     std::optional<std::span<const Eigen::Index>> free = std::nullopt) const;

private:
    [[nodiscard]] double place_of_point(Eigen::Index j) const;

    const models::System& system_;
    const Eigen::VectorXd& theta_;
    const PeriodicOrbit& orbit_;
    models::FlowOptions options_;
};

/// What a sensor reads along an orbit, with derivatives when asked for.
struct CurveReadings {
    bool simulated = false;         ///< everything else is meaningful only if so
    Eigen::MatrixXd readings;       ///< shape (n, m), in the place of each coordinate
    Eigen::MatrixXd by_phase;       ///< shape (n, m): d reading / d phase [per rad]
    Eigen::MatrixXd by_parameters;  ///< shape (n, m f): columns [k f, (k + 1) f) = d reading_k / d theta
};

/// Readings of a periodic orbit at the times of a record whose clock is at `phase` at time 0:
///
///     forced        yhat(t) = h(x*(phase + omega t))
///     autonomous    yhat(t) = h(x*(t_0 + phase T / 2 pi + t)),  x*(t_0) on the plane of `origin`
///
/// Derivatives to the parameters at a fixed phase: omega and T move the places too.
///
/// @param orbit   as SolvedCurve.
/// @param origin  used for autonomous flows only. A cycle that does not come near it within a quarter of T is not
///                `simulated`.
/// @param times   [s], any order.
[[nodiscard]] CurveReadings readings_along(const models::System& system, const Eigen::VectorXd& theta,
                                           const PeriodicOrbit& orbit, const PhaseOrigin& origin,
                                           const models::Sensor& sensor, std::span<const double> times, double phase,
                                           std::optional<std::span<const Eigen::Index>> free,
                                           const models::FlowOptions& options);

}  // namespace orbid::periodic

#pragma GCC visibility pop

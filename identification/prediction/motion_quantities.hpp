#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "periodic/branches/branch.hpp"
#include "periodic/solution/orbit_path.hpp"
#include "periodic/waveforms/orbit_measures.hpp"

namespace orbid::identification {

/// What is predicted of a motion, as one vector: the measures max, min, mean, half_range and rms of every coordinate
/// and then of every reading, the frequency, the modulus of the largest multiplier, and for single orbits the points.
struct MotionQuantities {
    Eigen::Index coordinates = 0;                  ///< of the model
    std::vector<periodic::OrbitReading> readings;  ///< formulas beside them
    Eigen::Index points = 0;                       ///< numbers that name the orbit: n p; 0 along branches

    [[nodiscard]] Eigen::Index read() const { return coordinates + std::ssize(readings); }
    [[nodiscard]] Eigen::Index frequency() const { return 5 * read(); }
    [[nodiscard]] Eigen::Index multiplier() const { return frequency() + 1; }
    [[nodiscard]] Eigen::Index first_point() const { return frequency() + 2; }
    [[nodiscard]] Eigen::Index count() const { return first_point() + points; }
    /// Of a coordinate or reading; any `of` for the frequency.
    [[nodiscard]] Eigen::Index of_measure(periodic::OrbitMeasure measure, Eigen::Index of) const {
        return measure == periodic::OrbitMeasure::frequency ? frequency() : 5 * of + static_cast<Eigen::Index>(measure);
    }
};

/// The quantities of an orbit with its amplitude; nan where one is not known. Angles of points as they are.
[[nodiscard]] Eigen::VectorXd quantities_of(const MotionQuantities& asked, const periodic::PeriodicOrbit& orbit,
                                            const periodic::OrbitAmplitude& amplitude);

/// Amplitude of an orbit: of the coordinates, and of the readings behind them where there are some.
[[nodiscard]] periodic::OrbitAmplitude amplitude_with_readings(const models::System& system,
                                                               const Eigen::VectorXd& values, double phase,
                                                               const periodic::PeriodicOrbit& orbit,
                                                               const std::vector<periodic::OrbitReading>& readings);

/// Derivatives of the quantities by parameters at a fixed kind of orbit, shape (count, f); nan where they are not
/// known: of the multiplier, and of measures of maps and of orbits that begin at another phase than 0.
/// @param orbit  with sensitivities to `free`
[[nodiscard]] Eigen::MatrixXd quantity_slopes(const MotionQuantities& asked, const models::System& system,
                                              const Eigen::VectorXd& values, double phase,
                                              const periodic::PeriodicOrbit& orbit, std::span<const Eigen::Index> free);

}  // namespace orbid::identification

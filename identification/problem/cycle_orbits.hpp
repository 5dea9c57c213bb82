#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "models/definition/sensor.hpp"
#include "models/system/system.hpp"
#include "orbits/cycles/cycle_waveform.hpp"
#include "periodic/orbit/shooting_mesh.hpp"

namespace orbid::identification {

/// An orbit of the model that a measured cycle is paired with.
struct PairedOrbit {
    periodic::StartingSolution start;  ///< a state and T
    double time = 0.0;                 ///< T of the orbit [s]
    double misfit = 0.0;               ///< mean square error over the variance of the readings, at equal shares of T
};

/// Pairs measured cycles of an autonomous flow with the model's periodic orbits, by nothing but the readings along
/// them.
///
/// The model's own motion at theta is searched for stretches whose readings are those along the cycle, when time runs
/// up to a fifth slower or faster there. Orbits are solved from the twelve nearest, at their crossings of a plane that
/// the motion returns to evenly (orbits::choose_plane()). The one that is most like the cycle is taken, at equal shares
/// of T and over all phases, so that parameters that are off by some ten per cent do not matter. A misfit above 0.1
/// makes no pair. An orbit belongs to one cycle at most.
///
/// @param theta        all parameters, shape (q)
/// @param coordinates  of the model, in the place of which the rows of the waveforms are read
/// @param sensor       what reads them
/// @return one per waveform; nothing where the model has no such orbit
/// @throws orbits::DataError where the model does not move for long enough to find orbits
[[nodiscard]] std::vector<std::optional<PairedOrbit>> paired_orbits(const models::System& system,
                                                                    const Eigen::VectorXd& theta,
                                                                    const std::vector<orbits::CycleWaveform>& waveforms,
                                                                    const std::vector<Eigen::Index>& coordinates,
                                                                    const models::Sensor& sensor);

}  // namespace orbid::identification

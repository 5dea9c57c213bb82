#pragma once

#include <vector>

#include <Eigen/Core>

#include "models/system/system.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/waveforms/waveform_curve.hpp"
#include "periodic/waveforms/waveform_record.hpp"
#include "periodic/waveforms/waveform_scan.hpp"

namespace orbid::periodic {

/// The orbit that a record is taken for before anything is estimated, and how the record lies against it.
struct WaveformStart {
    OrbitStatus status = OrbitStatus::no_progress;  ///< not converged: how the last of the attempts ended
    PeriodicOrbit orbit;                            ///< meaningful only if converged
    PhaseOrigin origin;                             ///< autonomous flows
    WaveformPlace place;                            ///< meaningful only if converged
};

/// Finds the periodic orbit of a record: Newton's method from the start that the record gives; or else from where the
/// model's own motion settles (stable orbits) after starts in measured states, in their mean, at 0 and at 1 in every
/// coordinate, and from the measured states themselves where the whole state is read (unstable orbits too). Each start
/// is taken for the state at phase 0 in turn when the clock of the record is not known. Of all orbits found, coexisting
/// ones among them, the one with the least misfit is taken, over all phases and offsets that are not known.
///
/// @param theta  all parameters of the system, in their domains, shape (q).
[[nodiscard]] WaveformStart find_waveform_start(const models::System& system, const Eigen::VectorXd& theta,
                                                const WaveformRecord& record,
                                                const std::vector<WaveformChannel>& channels,
                                                const models::FlowOptions& flow);

}  // namespace orbid::periodic

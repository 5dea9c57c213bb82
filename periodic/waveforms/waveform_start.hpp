#pragma once

#include "periodic/orbit/orbit.hpp"
#include "periodic/waveforms/waveform_curve.hpp"
#include "periodic/waveforms/waveform_scan.hpp"

namespace orbid::periodic {

/// The orbit assigned to a record before anything is estimated, and how the record fits it.
struct WaveformStart {
    OrbitStatus status = OrbitStatus::no_progress;  ///< not converged: how the last of the attempts ended
    PeriodicOrbit orbit;                            ///< meaningful only if converged
    PhaseOrigin origin;                             ///< autonomous flows
    WaveformPlace place;                            ///< meaningful only if converged
};

/// Finds the periodic orbit of a record by Newton's method from the start that the record gives. Without one, starts
/// are where the model's own motion settles (stable orbits), from measured states, their mean, and 0 and 1 in every
/// coordinate. Where the whole state is read, the measured states themselves are starts too (unstable orbits). If the
/// clock of the record is not known, each start is taken in turn for the state at phase 0. Of all orbits found,
/// including coexisting ones, the one with the least misfit is taken, over all unknown phases and offsets.
[[nodiscard]] WaveformStart find_waveform_start(const WaveformCase& of);

}  // namespace orbid::periodic

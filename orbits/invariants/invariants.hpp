#pragma once

#include <optional>
#include <string>

#include "orbits/cycles/cycle.hpp"
#include "orbits/invariants/correlation_dimension.hpp"
#include "orbits/invariants/cycle_expansion.hpp"
#include "orbits/invariants/lyapunov_spectrum.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

struct InvariantOptions {
    /// complete_to 0: unknown, no expansion is made.
    CycleExpansionOptions expansion;
    LyapunovOptions lyapunov;
    CorrelationOptions correlation;
};

/// Invariants of a measured set by three methods that share only the data.
struct Invariants {
    std::optional<CycleExpansion> expansion;
    std::string expansion_refused;  ///< why there is none, one sentence; empty when there is
    LyapunovSpectrum lyapunov;
    CorrelationDimension correlation;
};

/// Cycle expansion of the cycles found, Lyapunov spectrum and correlation dimension of the series itself.
///
/// A list of cycles that cannot be expanded (completeness not stated, inconsistent) is a result, not an error: it
/// depends on the data. At the defaults a series of any length costs about 3 x 10^5 local maps, 10^7 distances, and
/// neighbour searches over all its points.
///
/// @throws as lyapunov_spectrum and correlation_dimension; std::invalid_argument for complete_to outside [0, 64].
[[nodiscard]] Invariants find_invariants(const Series& series, const CycleSearch& search,
                                         const InvariantOptions& options = {});

}  // namespace orbid::orbits

#pragma GCC visibility pop

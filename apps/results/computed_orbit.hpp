#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "models/system/system.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/orbit/orbit_amplitude.hpp"
#include "periodic/stability/stability.hpp"

namespace orbid::apps {

/// One line of orbits.json: an orbit of the model, or what came of the start it was looked for at.
struct ComputedOrbit {
    periodic::PeriodicOrbit orbit;
    /// What was found instead, in words; empty when converged, unless an estimate does not use it.
    std::string message;
    std::optional<periodic::Stability> stability;
    /// "start": of the job; "cycle": measured; otherwise where a search had it from.
    std::string origin = "start";
    std::size_t hits = 1;       ///< starts of the search that led to it
    std::optional<int> mirror;  ///< index of its mirror image in the list, its own when symmetric
    bool computed = true;       ///< false: the run was interrupted before its turn
    /// Of the coordinates; empty where it was not computed.
    periodic::OrbitAmplitude amplitude{};

    [[nodiscard]] bool searched() const { return origin != "start" && origin != "cycle"; }
    [[nodiscard]] bool converged() const { return computed && orbit.status == periodic::OrbitStatus::converged; }
    /// The name of the orbit's status, or "interrupted".
    [[nodiscard]] std::string_view status() const;
};

/// Everything that the stage "periodic" has computed of single orbits.
struct ComputedOrbits {
    std::vector<ComputedOrbit> list;
    bool searched = false;
    std::size_t starts = 0;    ///< of the search, that were solved
    std::size_t captured = 0;  ///< trajectories of the search that ended in a stable orbit or at rest
    bool interrupted = false;
    bool own_time = false;  ///< autonomous models: T of an orbit is a result
    /// Periods whose last round of starts still brought something new, or was not reached.
    std::vector<int> unsettled{};
    /// Forced models, periods 1, 2, ...: sums of indices, the same for all of them where no orbit is missing.
    std::vector<int> index_sums{};

    [[nodiscard]] std::size_t converged() const;
};

/// What came of a start that did not lead to an orbit of its own period and rotation, in a sentence: what was found
/// instead, with period, rotation and distance, or how far from closed it stayed. Empty for a converged orbit.
///
/// @param asked  turns of each angle that were asked for; empty: any.
[[nodiscard]] std::string orbit_message(const periodic::PeriodicOrbit& orbit, const std::vector<int>& asked = {});

/// An orbit that was not found shows where it was looked for: points `start`, residual undefined. Others stay as they
/// are.
void show_start(periodic::PeriodicOrbit& orbit, const Eigen::MatrixXd& start);

/// "+1 -2": turns of the angles.
[[nodiscard]] std::string rotation_text(const std::vector<int>& rotation);

}  // namespace orbid::apps

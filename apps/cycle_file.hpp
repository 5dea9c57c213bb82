#pragma once

#include <optional>
#include <string>
#include <vector>

#include "apps/fingerprint.hpp"
#include "orbits/cycle_search.hpp"
#include "orbits/series.hpp"
#include "periodic/orbit.hpp"

namespace orbid::apps {

/// The plane that an autonomous flow crosses.
struct SectionPlane {
    std::string coordinate;
    double value = 0.0;
    int direction = 1;  ///< +1 rising, -1 falling
};

/// What stands above the list in cycles.json and orbits.json.
struct CycleFileHead {
    std::string model;
    std::vector<orbits::SeriesCoordinate> coordinates;
    std::optional<double> phase;             ///< of the section [rad]; forced models only
    std::optional<SectionPlane> plane = {};  ///< of autonomous models
    std::optional<double> forcing_period_s;  ///< gives the `time` of a cycle: period times this
    Fingerprint fingerprint;                 ///< left out of the file when its hash is empty
};

/// A list of cycles with what is known of its origin.
struct CycleFile {
    CycleFileHead head;
    orbits::CycleSearch search;
};

/// Content of cycles.json, format orbid-cycles/1. Undefined numbers and absent covariances
/// are null; numbers read back to the bit.
///
/// Beside the keys of the contract: `fingerprint`, `missing`, `candidates`, `rejected`, `patch_map`,
/// `reading_covariance`, `remarks`; of a cycle `time_sd` and `code`.
/// @throws std::invalid_argument when a cycle's shapes do not fit its period and the coordinates.
[[nodiscard]] std::string cycles_text(const CycleFile& file);

/// An orbit that was not found shows where it was looked for: points `start`, residual undefined. Others stay as they
/// are.
void show_start(periodic::PeriodicOrbit& orbit, const Eigen::MatrixXd& start);

/// Content of orbits.json: the same layout for computed orbits, plus `residual`, `status` and `sensitivities` (shape
/// (n p, f), columns named by the top-level key `parameters`) and `iterations`.
///
/// @param parameters  names of the f free parameters of the sensitivities.
/// @throws std::invalid_argument when an orbit's shapes do not fit its period, the coordinates and the parameters.
[[nodiscard]] std::string orbits_text(const CycleFileHead& head, const std::vector<periodic::PeriodicOrbit>& orbits,
                                      const std::vector<std::string>& parameters);

}  // namespace orbid::apps

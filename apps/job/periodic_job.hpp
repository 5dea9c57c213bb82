#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "apps/job/orbit_start.hpp"
#include "periodic/branches/continuation.hpp"
#include "periodic/search/orbit_search.hpp"
#include "periodic/solution/solve_orbit.hpp"
#include "periodic/waveforms/orbit_measures.hpp"

namespace orbid::apps {

/// Methods of the "periodic" block, in the order of periodic::OrbitMethod.
inline const std::vector<std::string> periodic_method_names{"multiple_shooting", "finite_difference", "collocation"};

/// A branch of orbits over one parameter, from the orbit that the job names.
struct ContinuationJob {
    std::size_t orbit = 0;  ///< of the list in orbits.json where it starts
    periodic::ContinuationOptions options;
    std::optional<Eigen::Index> plotted;  ///< coordinate shown in branch.svg; empty: the time T
    std::optional<periodic::OrbitMeasure>
        measure{};  ///< of it, along whole orbits; or the frequency, without coordinate
};

struct PeriodicJob {
    periodic::OrbitMethod method;
    std::vector<OrbitStart> orbits;
    std::optional<periodic::OrbitSearchOptions> search;  ///< phase and section are the job's
    std::optional<ContinuationJob> continuation;
    std::vector<Eigen::Index> free;  ///< parameters for sensitivities, different
    bool stability = false;          ///< directions, and derivatives of the multipliers to the free parameters
};

}  // namespace orbid::apps

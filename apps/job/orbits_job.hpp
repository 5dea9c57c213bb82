#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "orbits/cycles/cycle_search.hpp"
#include "orbits/invariants/cycle_expansion.hpp"

namespace orbid::apps {

/// Ways to find cycles by name, in the order of CycleSearchOptions::Method.
inline const std::vector<std::string> cycle_method_names{"auto", "local_maps", "patch_map", "closest_return"};

/// Orders of local maps by name; the index is CycleSearchOptions::order.
inline const std::vector<std::string> local_map_names{"auto",    "linear",  "quadratic", "cubic",
                                                      "quartic", "quintic", "sextic"};

/// States made from one reading of an autonomous flow.
struct EmbeddingJob {
    int delay = 0;      ///< [samples]; 0: first minimum of the mutual information
    int dimension = 0;  ///< 0: by false neighbours
};

/// Cycles come from a search in the section series, or from a file.
struct OrbitsJob {
    std::optional<std::filesystem::path> file;  ///< absolute path of a cycles.json
    std::string sha256;                         ///< of that file, expected; empty: not given
    orbits::CycleSearchOptions search;          ///< symmetry_signs filled from the model
    Eigen::VectorXd reading_sd;  ///< of a reading, one per coordinate of the model; empty: estimated from the series
    bool always = false;         ///< searched for even where the estimate needs no cycles
    bool invariants = false;     ///< exponents, dimensions and entropies from the series and, if complete, the cycles
    orbits::CycleExpansionOptions expansion = {};  ///< complete_to 0: not stated, no expansion
    std::optional<EmbeddingJob> embedding = {};    ///< of the only coordinate that is read
    std::size_t data = 0;                          ///< index into Job::data of the searched series; unused with `file`
};

}  // namespace orbid::apps

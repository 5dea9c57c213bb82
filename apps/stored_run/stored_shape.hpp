#pragma once

#include <filesystem>

#include "apps/stored_run/stored_run.hpp"

namespace orbid::apps {

/// Checks what others rely on in cycles.json, orbits.json and estimate_orbits.json: names of coordinates, and of every
/// cycle its period with as many points, each with one number per coordinate.
/// @throws DataError naming file, JSON Pointer and rule.
void check_cycle_list(const std::filesystem::path& file, const StoredRun::Json& json);

/// The same of result.json: kinds of values wherever they are used, and matrices that fit their names. A key may be
/// absent, as in files of earlier versions, but for "status" and "parameters".
void check_result(const std::filesystem::path& file, const StoredRun::Json& json);

/// The same of branch.json and estimate_branch.json, of every point of a branch.
void check_branch_list(const std::filesystem::path& file, const StoredRun::Json& json);

}  // namespace orbid::apps

#pragma once

#include "apps/job/job.hpp"

namespace orbid::apps {

/// Fills in the SHA-256 of every file that the job names: data, inputs, cycles. A stated SHA-256 must match the file.
/// @throws orbits::DataError naming a file that is missing or does not match.
void sign_files(Job& job);

}  // namespace orbid::apps

#pragma once

#include "apps/job/job.hpp"

namespace orbid::apps {

/// Fills in the SHA-256 of every file that the job names: data, inputs, cycles. A job that states one wants that very
/// file.
/// @throws orbits::DataError naming a file that is not there, or is another one.
void sign_files(Job& job);

}  // namespace orbid::apps

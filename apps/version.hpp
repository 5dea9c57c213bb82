#pragma once

#include "apps/job_writer.hpp"

namespace orbid::apps {

/// Version of the program, "0.1.0".
[[nodiscard]] std::string program_version();

/// The program, its compiler and the libraries whose versions can change a number.
[[nodiscard]] Versions versions();

}  // namespace orbid::apps

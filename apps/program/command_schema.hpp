#pragma once

#include <string>

#include "apps/program/command.hpp"

namespace orbid::apps {

/// The JSON Schema of jobs as text, and the page of all their keys: docs/job_reference.md.
[[nodiscard]] std::string job_schema_text();
[[nodiscard]] std::string job_reference_text();

/// The same of campaigns: docs/campaign_reference.md.
[[nodiscard]] std::string campaign_schema_text();
[[nodiscard]] std::string campaign_reference_text();

/// orbid schema [--campaign] [--markdown]: one of them on standard output.
[[nodiscard]] int show_schema(const CommandCall& call);

}  // namespace orbid::apps

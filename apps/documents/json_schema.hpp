#pragma once

#include <nlohmann/json.hpp>

#include "apps/documents/schema.hpp"

namespace orbid::apps {

/// The JSON Schema (draft 2020-12) of a description: a document is valid exactly when check_described() finds no
/// problem. Titles, defaults and units are annotations for editors.
///
/// Parts shared by several keys are in "$defs" under their names. Keys that depend on values of others become "if" and
/// "else", keys that exclude others "dependentSchemas".
[[nodiscard]] nlohmann::ordered_json json_schema(const ValueSchema& description);

}  // namespace orbid::apps

#pragma once

#include <nlohmann/json.hpp>

#include "apps/documents/schema.hpp"

namespace orbid::apps {

/// The JSON Schema (draft 2020-12) of a description: a document is valid by it exactly when check_described() finds
/// nothing wrong with it. Titles, defaults and units are annotations for editors.
///
/// What several keys share stands in "$defs" under its name. Keys that go with values of others become "if" and "else",
/// keys that exclude others "dependentSchemas".
[[nodiscard]] nlohmann::ordered_json json_schema(const ValueSchema& description);

}  // namespace orbid::apps

#pragma once

#include <vector>

#include "apps/documents/json_document.hpp"
#include "apps/documents/schema.hpp"

namespace orbid::apps {

/// Compares a document with its description and reports all differences: kinds, ranges, choices, counts, unknown,
/// missing and refused keys, incompatible keys.
///
/// Reported problems are marked in the document (JsonValue::flaw): readers treat a refused value as absent and need not
/// report it again. A document has no problems here exactly when the schema of the description accepts it. Only names
/// and numbers that depend on other parts of a document are checked elsewhere.
void check_described(JsonValue& value, const ValueSchema& description, std::vector<Problem>& problems);

}  // namespace orbid::apps

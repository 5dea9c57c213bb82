#pragma once

#include <vector>

#include "apps/documents/json_document.hpp"
#include "apps/documents/schema.hpp"

namespace orbid::apps {

/// Compares a document with its description and reports everything in which they differ: kinds, ranges, choices,
/// counts, unknown, missing and refused keys, keys that do not go together.
///
/// What is reported is marked in the document (JsonValue::flaw): readers take a refused value as absent, and need not
/// report it again. A document without problems here is one that the schema of the description accepts, and the other
/// way round; only names and numbers that depend on other parts of a document are checked elsewhere.
void check_described(JsonValue& value, const ValueSchema& description, std::vector<Problem>& problems);

}  // namespace orbid::apps

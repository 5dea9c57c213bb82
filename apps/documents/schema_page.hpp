#pragma once

#include <string>
#include <string_view>

#include "apps/documents/schema.hpp"

namespace orbid::apps {

/// A description as a page of Markdown: one table of keys per object, in the order of the description. Parts shared by
/// several keys follow at the end under their names.
/// @param title   of the page
/// @param opening Markdown below it
[[nodiscard]] std::string reference_page(const ValueSchema& description, std::string_view title,
                                         std::string_view opening);

}  // namespace orbid::apps

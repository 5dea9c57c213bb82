#pragma once

#include <string>
#include <string_view>

namespace orbid::apps {

/// Text for HTML and SVG, inside elements and inside quoted attributes: & < > " ' become references; control characters
/// and marks that turn the direction of writing are dropped, and what is not UTF-8 is replaced (visible()). What a job
/// calls its things reaches a page or a plot only through here.
[[nodiscard]] std::string markup_text(std::string_view text);

}  // namespace orbid::apps

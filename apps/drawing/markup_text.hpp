#pragma once

#include <string>
#include <string_view>

namespace orbid::apps {

/// Text for HTML and SVG, inside elements and inside quoted attributes: & < > " ' become references, control characters
/// that neither knows are dropped. What a job calls its things reaches a page or a plot only through here.
[[nodiscard]] std::string markup_text(std::string_view text);

}  // namespace orbid::apps

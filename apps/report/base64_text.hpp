#pragma once

#include <span>
#include <string>

namespace orbid::apps {

/// Bytes as base64 (RFC 4648, section 4) on one line, with padding.
[[nodiscard]] std::string base64_text(std::span<const unsigned char> bytes);

}  // namespace orbid::apps

#pragma once

#include <string>
#include <string_view>

namespace orbid::apps {

/// Bytes as a stream of zlib (RFC 1950), which carries a checksum of what went in. Python: zlib.decompress().
[[nodiscard]] std::string compressed(std::string_view bytes);

/// Inverse of compressed().
/// @throws std::runtime_error saying what is wrong when the bytes are no whole stream of zlib.
[[nodiscard]] std::string uncompressed(std::string_view bytes);

}  // namespace orbid::apps

#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace orbid::apps {

/// Files whose paths match a pattern (glob(3): * and ? stand for letters), in the order of bytes.
[[nodiscard]] std::vector<std::filesystem::path> matching_files(const std::string& pattern);

}  // namespace orbid::apps

#include "apps/documents/file_pattern.hpp"

#include <glob.h>

#include <algorithm>

namespace orbid::apps {

std::vector<std::filesystem::path> matching_files(const std::string& pattern) {
    glob_t found{};
    std::vector<std::filesystem::path> paths;
    if (::glob(pattern.c_str(), 0, nullptr, &found) == 0) paths.assign(found.gl_pathv, found.gl_pathv + found.gl_pathc);
    ::globfree(&found);
    std::erase_if(paths, [](const auto& path) { return !std::filesystem::is_regular_file(path); });
    std::sort(paths.begin(), paths.end());
    return paths;
}

}  // namespace orbid::apps

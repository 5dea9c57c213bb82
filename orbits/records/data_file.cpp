#include "orbits/records/data_file.hpp"

#include <algorithm>
#include <system_error>

#include <fmt/format.h>

#include "orbits/records/refusal.hpp"

namespace orbid::orbits {

std::uintmax_t require_data_file(const std::filesystem::path& file) {
    std::error_code error;
    const auto status = std::filesystem::status(file, error);
    refuse_record_if(status.type() == std::filesystem::file_type::not_found, "{}: no such file", file.string());
    refuse_record_if(std::filesystem::is_directory(status), "{}: is a folder; a file with data is needed",
                     file.string());
    refuse_record_if(std::filesystem::exists(status) && !std::filesystem::is_regular_file(status),
                     "{}: is a pipe or a device; data are read more than once, so they must be in a file",
                     file.string());
    const std::uintmax_t size = std::filesystem::file_size(file, error);
    refuse_record_if(static_cast<bool>(error), "{}: cannot be read: {}", file.string(), error.message());
    return size;
}

std::string shown_names(const std::vector<std::string>& names) {
    constexpr std::size_t most = 40, longest = 60;
    std::string text;
    for (std::size_t i = 0; i < std::min(names.size(), most); ++i)
        text += fmt::format("{}\"{}{}\"", i == 0 ? "" : ", ", names[i].substr(0, longest),
                            names[i].size() > longest ? "..." : "");
    if (names.size() > most) text += fmt::format(" and {} more", names.size() - most);
    return text;
}

}  // namespace orbid::orbits

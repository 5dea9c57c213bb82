#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace orbid::orbits {

/// Longest line of a table [bytes] and most columns of it: what is longer is no table.
inline constexpr std::size_t longest_table_line = std::size_t{16} << 20;
inline constexpr std::size_t most_table_columns = 100'000;

/// Refuses what is no file, before it is opened: on a pipe one waits for who writes, and a device need not end. Data
/// are read more than once.
/// @return its size [bytes]
/// @throws DataError naming the file: it does not exist, is a folder, a pipe, a device or a socket.
std::uintmax_t require_data_file(const std::filesystem::path& file);

/// `"a", "b", "c"` for messages. Of many names the first ones, and how many there are besides; long ones are cut.
[[nodiscard]] std::string shown_names(const std::vector<std::string>& names);

}  // namespace orbid::orbits

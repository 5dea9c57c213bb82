#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace orbid::fuzz {

/// One way for bytes from outside into the program. It must return, whatever the bytes are: what is wrong with them is
/// refused as the program refuses it. Anything else, an exception of another type too, is a finding.
struct Target {
    std::string_view name;  ///< of its folder in corpus/ as well
    void (*take)(std::string_view bytes);
};

[[nodiscard]] std::vector<Target> record_targets();    ///< formulas, tables, HDF5
[[nodiscard]] std::vector<Target> document_targets();  ///< jobs, cycles, orbits, checkpoints, stored folders

/// Both. @throws std::invalid_argument when there is none of this name.
[[nodiscard]] std::vector<Target> all_targets();
[[nodiscard]] Target target_named(std::string_view name);

/// A folder of this process, in memory if there is one; it goes with the process.
[[nodiscard]] const std::filesystem::path& place();
/// Puts a file into it.
std::filesystem::path written(const std::string& name, std::string_view bytes);

}  // namespace orbid::fuzz

#pragma once

#include <string_view>
#include <vector>

namespace orbid::fuzz {

/// One way for bytes from outside into the program. It must return, whatever the bytes are: what is wrong with them is
/// refused as the program refuses it. Anything else, an exception of another type too, is a finding.
struct Target {
    std::string_view name;  ///< of its folder in corpus/ as well
    void (*take)(std::string_view bytes);
};

[[nodiscard]] std::vector<Target> text_targets();  ///< jobs, formulas, cycles, orbits, checkpoints
[[nodiscard]] std::vector<Target> file_targets();  ///< tables, HDF5, stored results

/// Both. @throws std::invalid_argument when there is none of this name.
[[nodiscard]] std::vector<Target> all_targets();
[[nodiscard]] Target target_named(std::string_view name);

}  // namespace orbid::fuzz

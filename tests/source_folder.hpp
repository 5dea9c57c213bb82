#pragma once

#include <string>

namespace orbid::tests {

/// Folder of the project's sources, which holds reference values and example jobs. A function rather than a macro: with
/// the folder in its command line an object could not be shared by two clones.
[[nodiscard]] std::string source_folder();

}  // namespace orbid::tests

#pragma once

#include <optional>
#include <string>

#include "models/equations/equations.hpp"

namespace orbid::models {

/// The name of the function that a compiled model exports: `const orbid::models::Kernel* orbid_equations()`.
inline constexpr const char* equation_entry = "orbid_equations";

/// A model written as text, translated to C++: a struct that satisfies Model, and the function that returns its kernel.
///
/// Nothing of the text enters but its numbers, in hexadecimal. Names are generated, so the same formulas under other
/// names give the same source.
///
/// @return nothing for shapes that would take too long to compile; `why` then says so. These have more than eight
///         coordinates and switch, are forced, have angles, or read inputs.
[[nodiscard]] std::optional<std::string> equation_source(const Equations& equations, std::string& why);

}  // namespace orbid::models

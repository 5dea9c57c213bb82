#pragma once

#include <optional>
#include <string>

#include "models/equations/equations.hpp"

namespace orbid::models {

/// The name of the function that a compiled model exports: `const orbid::models::Kernel* orbid_equations()`.
inline constexpr const char* equation_entry = "orbid_equations";

/// A model written as text as C++: a struct that satisfies Model, and the function that gives its kernel.
///
/// Nothing of the text gets into it but its numbers, in hexadecimal: names are generated, so that the same formulas
/// under other names are the same source.
///
/// @return nothing for shapes that take no sensible time to compile (more than eight coordinates that switch, are
///         forced, angles, or read inputs); `why` then says so.
[[nodiscard]] std::optional<std::string> equation_source(const Equations& equations, std::string& why);

}  // namespace orbid::models

#pragma once

#include <memory>
#include <string>

#include "models/equations/equation_program.hpp"
#include "models/equations/equations.hpp"
#include "models/system/kernel.hpp"

namespace orbid::models {

/// A model written as text, evaluated instruction by instruction. No compiler is needed, but it is slower.
///
/// The flows are computed by one of a few shapes of models that were compiled with the library (interpreted_model.hpp).
/// A shape with more coordinates than asked for leaves the last ones at 0.
///
/// @return nothing where no shape fits; `why` then says what is too much for them.
[[nodiscard]] std::shared_ptr<const Kernel> interpreted_kernel(const std::shared_ptr<const Equations>& equations,
                                                               std::string& why);

}  // namespace orbid::models

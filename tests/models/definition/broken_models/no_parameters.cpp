// Says: a model needs a table of its parameters
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::no_parameters {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Equations {};
#else
struct Model : Texts, Coordinates, Equations {};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::no_parameters

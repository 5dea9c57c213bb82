// Says: a model has rhs, x' = f, or map
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::rhs_and_map {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Map {};
#else
struct Model : Sound, Map {};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::rhs_and_map

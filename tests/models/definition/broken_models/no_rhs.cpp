// Says: a model needs its equations: template
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::no_rhs {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Equations {};
#else
struct Model : Texts, Coordinates, Parameters {};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::no_rhs

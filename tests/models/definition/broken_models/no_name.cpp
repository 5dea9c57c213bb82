// Says: a model needs its name
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::no_name {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Equations {};
#else
struct Model : Coordinates, Parameters, Equations {};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::no_name

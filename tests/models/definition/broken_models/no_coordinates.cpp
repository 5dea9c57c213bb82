// Says: a model needs a table of its coordinates
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::no_coordinates {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Equations {};
#else
struct Model : Texts, Parameters, Equations {};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::no_coordinates

// Says: rhs of a model with surfaces must take all sides
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::one_side_of_surfaces {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Surfaces, SurfaceEquations, Smooth {};
#else
struct Model : Texts, Coordinates, Parameters, Surfaces, SidedEquations, Smooth {};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::one_side_of_surfaces

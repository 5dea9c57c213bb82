// Says: a model with surfaces needs smooth(p)
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::surfaces_without_smooth {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Surfaces, SurfaceEquations, Smooth {};
#else
struct Model : Texts, Coordinates, Parameters, Surfaces, SurfaceEquations {};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::surfaces_without_smooth

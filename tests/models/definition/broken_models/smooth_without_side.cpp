// Says: smooth(p) says that f may jump: rhs must take the side
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::smooth_without_side {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, SidedEquations, Smooth {};
#else
struct Model : Sound, Smooth {};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::smooth_without_side

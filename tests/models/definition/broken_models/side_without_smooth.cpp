// Says: rhs takes a side, so smooth(p) must say
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::side_without_smooth {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, SidedEquations, Smooth {};
#else
struct Model : Texts, Coordinates, Parameters, SidedEquations {};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::side_without_smooth

// Says: smooth must be static bool smooth
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::smooth_of_other_type {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, SidedEquations, Smooth {};
#else
struct Model : Texts, Coordinates, Parameters, SidedEquations {
    static double smooth(const Values<double, 2>& p) { return p[1]; }
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::smooth_of_other_type

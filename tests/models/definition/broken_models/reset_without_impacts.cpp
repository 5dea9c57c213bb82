// Says: reset(j, t, x, p) is there: impacts
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::reset_without_impacts {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Surfaces, SurfaceEquations, Smooth, Reset {
    static constexpr std::array<bool, 1> impacts{true};
};
#else
struct Model : Texts, Coordinates, Parameters, Surfaces, SurfaceEquations, Smooth, Reset {};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::reset_without_impacts

// Says: impacts says that the state jumps
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::impacts_without_reset {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Surfaces, SurfaceEquations, Smooth, Reset {
    static constexpr std::array<bool, 1> impacts{true};
};
#else
struct Model : Texts, Coordinates, Parameters, Surfaces, SurfaceEquations, Smooth {
    static constexpr std::array<bool, 1> impacts{true};
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::impacts_without_reset

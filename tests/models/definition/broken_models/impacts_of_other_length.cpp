// Says: impacts must be a std::array<bool, surface_count>
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::impacts_of_other_length {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Surfaces, SurfaceEquations, Smooth, Reset {
    static constexpr std::array<bool, 1> impacts{true};
};
#else
struct Model : Texts, Coordinates, Parameters, Surfaces, SurfaceEquations, Smooth, Reset {
    static constexpr std::array<bool, 2> impacts{true};
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::impacts_of_other_length

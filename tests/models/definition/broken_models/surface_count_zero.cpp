// Says: surface_count must be a number > 0
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::surface_count_zero {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Surfaces, SurfaceEquations, Smooth {};
#else
struct Model : Sound {
    static constexpr std::size_t surface_count = 0;
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::surface_count_zero

// Says: surface_count says that there are switching surfaces
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::no_surfaces {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Surfaces, SurfaceEquations, Smooth {};
#else
struct Model : Texts, Coordinates, Parameters, SurfaceEquations, Smooth {
    static constexpr std::size_t surface_count = 1;
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::no_surfaces

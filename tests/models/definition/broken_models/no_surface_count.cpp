// Says: surfaces(t, x, p) is there: surface_count must say how many
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::no_surface_count {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Surfaces, SurfaceEquations, Smooth {};
#else
struct Model : Sound {
    template <class T>
    static Values<T, 1> surfaces(const T& /*t*/, const State<T, 2>& x, const Values<T, 2>& /*p*/) {
        return {x[0]};
    }
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::no_surface_count

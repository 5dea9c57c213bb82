// Says: surfaces(t, x, p) must return Values<T, surface_count>
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::surfaces_of_other_length {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Surfaces, SurfaceEquations, Smooth {};
#else
struct Model : Texts, Coordinates, Parameters, SurfaceEquations, Smooth {
    static constexpr std::size_t surface_count = 1;
    template <class T>
    static Values<T, 2> surfaces(const T& /*t*/, const State<T, 2>& x, const Values<T, 2>& /*p*/) {
        return x;
    }
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::surfaces_of_other_length

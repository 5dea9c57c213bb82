// Says: map takes numbers but not numbers with derivatives
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::map_without_derivatives {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Map {};
#else
struct Model : Texts, Coordinates, Parameters {
    static State<double, 2> map(const State<double, 2>& x, const Values<double, 2>& p) { return {x[1], p[0] * x[0]}; }
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::map_without_derivatives

// Says: the one side of friction is for two coordinates
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::friction_of_three {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, SidedEquations, Smooth {};
#else
struct Model : Texts, Parameters, Smooth {
    static constexpr std::array coordinates{real("x", "m"), real("v", "m/s"), real("w", "m")};
    template <class T>
    static State<T, 3> rhs(const T& /*t*/, const State<T, 3>& x, const Values<T, 2>& p, double side) {
        return {x[1], -p[0] * x[0] - side * p[1], x[0]};
    }
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::friction_of_three

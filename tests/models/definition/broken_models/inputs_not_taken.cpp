// Says: there is a table of inputs: rhs must take their values
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::inputs_not_taken {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters {
    static constexpr std::array inputs{real("u", "m/s^2")};
    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 2>& p, const std::array<T, 1>& u) {
        return {x[1], -p[0] * x[0] + u[0]};
    }
};
#else
struct Model : Texts, Coordinates, Parameters {
    static constexpr std::array inputs{real("u", "m/s^2")};
    template <class T>
    static State<T, 2> rhs(const T& /*t*/, const State<T, 2>& x, const Values<T, 2>& p) {
        return {x[1], -p[0] * x[0]};
    }
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::inputs_not_taken

// Says: rhs cannot be called as rhs(t, x, p)
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::rhs_without_time {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Equations {};
#else
struct Model : Texts, Coordinates, Parameters {
    template <class T>
    static State<T, 2> rhs(const State<T, 2>& x, const Values<T, 2>& p) {
        return {x[1], -p[0] * x[0]};
    }
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::rhs_without_time

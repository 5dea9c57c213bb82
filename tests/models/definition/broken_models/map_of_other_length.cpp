// Says: map cannot be called as map(x, p)
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::map_of_other_length {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters {
    template <class T>
    static State<T, 2> map(const State<T, 2>& x, const Values<T, 2>& p) {
        return {x[1], p[0] * x[0]};
    }
};
#else
struct Model : Texts, Coordinates, Parameters {
    template <class T>
    static State<T, 3> map(const State<T, 3>& x, const Values<T, 2>& p) {
        return {x[1], p[0] * x[0], x[2]};
    }
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::map_of_other_length

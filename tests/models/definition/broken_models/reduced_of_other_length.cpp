// Says: reduced must be template
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::reduced_of_other_length {

#ifdef REPAIRED
struct Model : Sound {
    template <class T>
    static Values<T, 2> reduced(const Values<T, 2>& p) {
        return {p[0], p[1]};
    }
};
#else
struct Model : Sound {
    template <class T>
    static Values<T, 2> reduced(const Values<T, 3>& p) {
        return {p[0], p[1]};
    }
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::reduced_of_other_length

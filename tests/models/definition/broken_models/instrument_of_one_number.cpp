// Says: instrument must be template
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::instrument_of_one_number {

#ifdef REPAIRED
struct Model : Sound {
    template <class T>
    static State<T, 2> instrument(const State<T, 2>& x, const Values<T, 2>& /*p*/) {
        return x;
    }
};
#else
struct Model : Sound {
    template <class T>
    static T instrument(const State<T, 2>& x, const Values<T, 2>& /*p*/) {
        return x[0];
    }
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::instrument_of_one_number

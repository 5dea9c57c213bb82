// Says: forcing(phase, p) and rhs_forced(forcing, x, p, side) go together
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::forcing_without_rhs {

#ifdef REPAIRED
struct Model : Sound {
    static constexpr std::size_t forcing_frequency = 0;
};
#else
struct Model : Sound {
    static constexpr std::size_t forcing_frequency = 0;
    template <class T>
    static T forcing(const T& phase, const Values<T, 2>& /*p*/) {
        return phase;
    }
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::forcing_without_rhs

// Says: the parameter at forcing_frequency must be positive
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::frequency_may_be_zero {

#ifdef REPAIRED
struct Model : Sound {
    static constexpr std::size_t forcing_frequency = 0;
};
#else
struct Model : Sound {
    static constexpr std::size_t forcing_frequency = 1;
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::frequency_may_be_zero

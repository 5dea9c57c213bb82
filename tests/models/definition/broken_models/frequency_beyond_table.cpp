// Says: forcing_frequency must be the index of a parameter
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::frequency_beyond_table {

#ifdef REPAIRED
struct Model : Sound {
    static constexpr std::size_t forcing_frequency = 0;
};
#else
struct Model : Sound {
    static constexpr std::size_t forcing_frequency = 2;
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::frequency_beyond_table

// Says: a model has forcing_frequency or inputs, not both
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::forced_by_input {

#ifdef REPAIRED
struct Model : Sound {
    static constexpr std::size_t forcing_frequency = 0;
};
#else
struct Model : Sound {
    static constexpr std::size_t forcing_frequency = 0;
    static constexpr std::array inputs{real("u", "N")};
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::forced_by_input

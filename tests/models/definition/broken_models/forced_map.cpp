// Says: a map has no forcing_frequency
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::forced_map {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Map {};
#else
struct Model : Texts, Coordinates, Parameters, Map {
    static constexpr std::size_t forcing_frequency = 0;
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::forced_map

// Says: names of coordinates must differ
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::coordinate_without_name {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Equations {};
#else
struct Model : Sound {
    static constexpr std::array coordinates{real("", "m"), real("v", "m/s")};
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::coordinate_without_name

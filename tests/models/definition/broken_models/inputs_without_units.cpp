// Says: inputs must be a std::array of names with units
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::inputs_without_units {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Equations {};
#else
struct Model : Sound {
    static constexpr std::array<std::string_view, 1> inputs{"u"};
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::inputs_without_units

// Says: coordinates must be a std::array of one or more
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::coordinates_of_text {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Equations {};
#else
struct Model : Sound {
    static constexpr std::array<std::string_view, 2> coordinates{"x", "v"};
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::coordinates_of_text

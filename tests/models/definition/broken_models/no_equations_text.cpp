// Says: a model needs its equations as text
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::no_equations_text {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Equations {};
#else
struct Named {
    static constexpr std::string_view name = "broken";
    static constexpr std::string_view summary = "x";
};
struct Model : Named, Coordinates, Parameters, Equations {};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::no_equations_text

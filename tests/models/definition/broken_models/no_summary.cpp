// Says: a model needs a summary
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::no_summary {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Equations {};
#else
struct Named {
    static constexpr std::string_view name = "broken";
    static constexpr std::string_view equations = "x";
};
struct Model : Named, Coordinates, Parameters, Equations {};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::no_summary

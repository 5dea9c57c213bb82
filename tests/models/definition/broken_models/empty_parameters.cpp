// Says: parameters must be a std::array of one or more
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::empty_parameters {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Equations {};
#else
struct Model : Sound {
    static constexpr std::array<Parameter, 0> parameters{};
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::empty_parameters

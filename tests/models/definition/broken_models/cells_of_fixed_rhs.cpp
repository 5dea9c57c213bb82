// Says: rhs of a model of any size must be
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::cells_of_fixed_rhs {

#ifdef REPAIRED
struct Model : Texts, Parameters, Cells, CellEquations {};
#else
struct Model : Texts, Parameters, Cells, Equations {};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::cells_of_fixed_rhs

// Says: a model needs its equations: template <class T> static void rhs
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::cells_without_rhs {

#ifdef REPAIRED
struct Model : Texts, Parameters, Cells, CellEquations {};
#else
struct Model : Texts, Parameters, Cells {};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::cells_without_rhs

// Says: a model has a table `coordinates`, or one `coordinate`
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::cells_and_coordinates {

#ifdef REPAIRED
struct Model : Texts, Parameters, Cells, CellEquations {};
#else
struct Model : Texts, Parameters, Cells, Coordinates, CellEquations {};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::cells_and_coordinates

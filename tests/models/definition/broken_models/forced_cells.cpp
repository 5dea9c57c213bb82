// Says: a model of any size is autonomous, smooth and not stiff
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::forced_cells {

#ifdef REPAIRED
struct Model : Texts, Parameters, Cells, CellEquations {};
#else
struct Model : Texts, Parameters, Cells, CellEquations {
    static constexpr std::size_t forcing_frequency = 0;
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::forced_cells

// Says: a model of any size needs what one of its cells holds
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::cells_without_coordinate {

#ifdef REPAIRED
struct Model : Texts, Parameters, Cells, CellEquations {};
#else
struct Sizes {
    static constexpr std::size_t smallest_size = 2, default_size = 5;
};
struct Model : Texts, Parameters, Sizes, CellEquations {};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::cells_without_coordinate

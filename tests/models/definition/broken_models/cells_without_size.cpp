// Says: a model of any size needs static constexpr std::size_t
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::cells_without_size {

#ifdef REPAIRED
struct Model : Texts, Parameters, Cells, CellEquations {};
#else
struct Cell {
    static constexpr Coordinate coordinate = real("x", "m");
};
struct Model : Texts, Parameters, Cell, CellEquations {};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::cells_without_size

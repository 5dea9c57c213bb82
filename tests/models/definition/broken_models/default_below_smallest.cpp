// Says: sizes must be 0 < smallest_size <= default_size
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::default_below_smallest {

#ifdef REPAIRED
struct Model : Texts, Parameters, Cells, CellEquations {
    static constexpr std::size_t smallest_size = 5;
};
#else
struct Model : Texts, Parameters, Cells, CellEquations {
    static constexpr std::size_t smallest_size = 6;
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::default_below_smallest

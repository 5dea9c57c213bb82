// Says: symmetry_signs must have one sign for each coordinate
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::signs_of_other_length {

#ifdef REPAIRED
struct Model : Sound {
    static constexpr std::array<double, 2> symmetry_signs{-1.0, -1.0};
    static constexpr double symmetry_phase_shift = 0.0;
};
#else
struct Model : Sound {
    static constexpr std::array<double, 3> symmetry_signs{-1.0, -1.0, 1.0};
    static constexpr double symmetry_phase_shift = 0.0;
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::signs_of_other_length

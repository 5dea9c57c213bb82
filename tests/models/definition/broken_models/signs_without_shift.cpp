// Says: symmetry_signs is there: symmetry_phase_shift must say
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::signs_without_shift {

#ifdef REPAIRED
struct Model : Sound {
    static constexpr std::array<double, 2> symmetry_signs{-1.0, -1.0};
    static constexpr double symmetry_phase_shift = 0.0;
};
#else
struct Model : Sound {
    static constexpr std::array<double, 2> symmetry_signs{-1.0, -1.0};
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::signs_without_shift

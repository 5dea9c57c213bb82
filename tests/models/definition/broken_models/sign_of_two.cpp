// Says: symmetry_signs must be 1 or -1
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::sign_of_two {

#ifdef REPAIRED
struct Model : Sound {
    static constexpr std::array<double, 2> symmetry_signs{-1.0, -1.0};
    static constexpr double symmetry_phase_shift = 0.0;
};
#else
struct Model : Sound {
    static constexpr std::array<double, 2> symmetry_signs{2.0, -1.0};
    static constexpr double symmetry_phase_shift = 0.0;
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::sign_of_two

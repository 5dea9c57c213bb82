// Says: symmetry_phase_shift must be 0 for a model that is not forced
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::shift_without_forcing {

#ifdef REPAIRED
struct Model : Sound {
    static constexpr std::array<double, 2> symmetry_signs{-1.0, -1.0};
    static constexpr double symmetry_phase_shift = 0.0;
};
#else
struct Model : Sound {
    static constexpr std::array<double, 2> symmetry_signs{-1.0, -1.0};
    static constexpr double symmetry_phase_shift = 3.0;
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::shift_without_forcing

// Says: the default of a parameter must lie in its domain
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::default_outside {

#ifdef REPAIRED
struct Model : Sound {
    static constexpr std::array parameters{Parameter{"k", "1/s^2", nonnegative, 0.0, "stiffness", typical(1.0)},
                                           Parameter{"c", "1/s", positive, 1.0, "friction"}};
};
#else
struct Model : Sound {
    static constexpr std::array parameters{Parameter{"k", "1/s^2", positive, 0.0, "stiffness", typical(1.0)},
                                           Parameter{"c", "1/s", positive, 1.0, "friction"}};
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::default_outside

// Says: names of parameters must differ
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::parameter_twice {

#ifdef REPAIRED
struct Model : Sound {
    static constexpr std::array parameters{Parameter{"k", "1/s^2", positive, 1.0, "stiffness"},
                                           Parameter{"c", "1/s", positive, 1.0, "friction"}};
};
#else
struct Model : Sound {
    static constexpr std::array parameters{Parameter{"k", "1/s^2", positive, 1.0, "stiffness"},
                                           Parameter{"k", "1/s", positive, 1.0, "friction"}};
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::parameter_twice

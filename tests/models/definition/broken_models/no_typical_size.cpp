// Says: a parameter whose default is 0 needs typical(size)
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::no_typical_size {

#ifdef REPAIRED
struct Model : Texts, Coordinates, Parameters, Equations {};
#else
struct Model : Sound {
    static constexpr std::array parameters{Parameter{"k", "1/s^2", positive, 1.0, "stiffness"},
                                           Parameter{"c", "1/s", nonnegative, 0.0, "friction"}};
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::no_typical_size

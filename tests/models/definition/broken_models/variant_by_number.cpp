// Says: variant must be a name
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::variant_by_number {

#ifdef REPAIRED
struct Model : Sound {
    static constexpr std::string_view variant = "first";
};
#else
struct Model : Sound {
    static constexpr int variant = 1;
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::variant_by_number

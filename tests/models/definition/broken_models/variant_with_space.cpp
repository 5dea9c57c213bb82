// Says: the name of a variant must be letters
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::variant_with_space {

#ifdef REPAIRED
struct Model : Sound {
    static constexpr std::string_view variant = "first";
};
#else
struct Model : Sound {
    static constexpr std::string_view variant = "the first";
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::variant_with_space

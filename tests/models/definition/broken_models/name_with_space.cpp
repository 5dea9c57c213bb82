// Says: the name of a model must be letters
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::name_with_space {

#ifdef REPAIRED
struct Model : Sound {
    static constexpr std::string_view name = "two_words";
};
#else
struct Model : Sound {
    static constexpr std::string_view name = "two words";
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::name_with_space

// Says: packs must be true or false
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::packs_in_words {

#ifdef REPAIRED
struct Model : Sound {
    static constexpr bool packs = false;
};
#else
struct Model : Sound {
    static constexpr std::string_view packs = "no";
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::packs_in_words

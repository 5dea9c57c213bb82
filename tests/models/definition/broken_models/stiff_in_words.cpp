// Says: stiff must be true or false
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::stiff_in_words {

#ifdef REPAIRED
struct Model : Sound {
    static constexpr bool stiff = true;
};
#else
struct Model : Sound {
    static constexpr std::string_view stiff = "yes";
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::stiff_in_words

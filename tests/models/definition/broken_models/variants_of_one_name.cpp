// Says: variants of a model must have different names
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::variants_of_one_name {

#ifdef REPAIRED
struct First : Sound {
    static constexpr std::string_view variant = "first";
};
struct Second : Sound {
    static constexpr std::string_view variant = "second";
};
struct Model {
    using variants = std::tuple<First, Second>;
};
#else
struct First : Sound {
    static constexpr std::string_view variant = "first";
};
struct Second : Sound {
    static constexpr std::string_view variant = "first";
};
struct Model {
    using variants = std::tuple<First, Second>;
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::variants_of_one_name

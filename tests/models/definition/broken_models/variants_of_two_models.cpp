// Says: variants of a model must share its name
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::variants_of_two_models {

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
    static constexpr std::string_view name = "other";
    static constexpr std::string_view variant = "second";
};
struct Model {
    using variants = std::tuple<First, Second>;
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::variants_of_two_models

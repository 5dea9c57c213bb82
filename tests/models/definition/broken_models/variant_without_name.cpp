// Says: each of the variants of a model needs the name of its form
#include "tests/models/definition/broken_models/parts.hpp"

namespace orbid::models::parts::variant_without_name {

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
struct Second : Sound {};
struct Model {
    using variants = std::tuple<First, Second>;
};
#endif

constexpr bool checked = is_complete<Model>();

}  // namespace orbid::models::parts::variant_without_name

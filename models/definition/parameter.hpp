#pragma once

#include <array>
#include <cstddef>
#include <string_view>
#include <utility>

#pragma GCC visibility push(default)

namespace orbid::models {

/// Where the value of a parameter may lie. Checked before a flow is asked for; the model itself never checks.
enum class Domain { real, positive, nonnegative };

inline constexpr Domain any_real = Domain::real;
inline constexpr Domain positive = Domain::positive;
inline constexpr Domain nonnegative = Domain::nonnegative;

/// True when value lies in the domain; nan and infinities lie in none.
[[nodiscard]] bool contains(Domain domain, double value);

/// The rule in words, for messages: "a finite number", "> 0", ">= 0".
[[nodiscard]] std::string_view rule(Domain domain);

/// Size of a parameter when its value gives none (default 0): the unit of steps and null directions.
struct Typical {
    double size;
};
constexpr Typical typical(double size) {
    return {size};
}

/// One parameter of a model: name, unit, domain and default.
struct Parameter {
    std::string_view name;
    std::string_view unit;
    Domain domain;
    double default_value;
    std::string_view description;
    double typical_size;  ///< > 0

    constexpr Parameter(std::string_view name_, std::string_view unit_, Domain domain_, double default_value_,
                        std::string_view description_)
        : Parameter(name_, unit_, domain_, default_value_, description_,
                    typical(default_value_ < 0 ? -default_value_ : default_value_)) {}

    constexpr Parameter(std::string_view name_, std::string_view unit_, Domain domain_, double default_value_,
                        std::string_view description_, Typical typical_)
        : name(name_),
          unit(unit_),
          domain(domain_),
          default_value(default_value_),
          description(description_),
          typical_size(typical_.size) {}
};

/// A table with those of `first`, then those of `others`.
template <std::size_t n, std::size_t m>
constexpr std::array<Parameter, n + m> joined(const std::array<Parameter, n>& first,
                                              const std::array<Parameter, m>& others) {
    return [&]<std::size_t... i, std::size_t... j>(std::index_sequence<i...>, std::index_sequence<j...>) {
        return std::array<Parameter, n + m>{first[i]..., others[j]...};
    }
    (std::make_index_sequence<n>{}, std::make_index_sequence<m>{});
}

/// One coordinate of the state. An angle lives on a circle of 2 pi rad: differences are taken modulo 2 pi.
struct Coordinate {
    std::string_view name;
    std::string_view unit;
    bool angle;
};

constexpr Coordinate real(std::string_view name, std::string_view unit) {
    return {name, unit, false};
}
constexpr Coordinate angle(std::string_view name, std::string_view unit) {
    return {name, unit, true};
}

/// The representative of an angle in (-pi, pi].
[[nodiscard]] double wrapped(double angle_rad);

}  // namespace orbid::models

#pragma GCC visibility pop

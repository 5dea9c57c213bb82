#pragma once

#include <cstddef>
#include <cstring>

namespace orbid::models {

/// Doubles of a vector register of the machine that the file is compiled for.
#if defined(__AVX512F__)
inline constexpr std::size_t register_width = 8;
#elif defined(__AVX__)
inline constexpr std::size_t register_width = 4;
#else
inline constexpr std::size_t register_width = 2;
#endif

namespace detail {
template <std::size_t width>
struct RegisterOf {
    using type __attribute__((vector_size(width * sizeof(double)))) = double;
};
template <>
struct RegisterOf<1> {
    using type = double;
};
}  // namespace detail

/// So many doubles in a register, with the arithmetic that GCC and Clang give it; one is a double. width <=
/// register_width, a power of 2.
template <std::size_t width>
using VectorRegister = typename detail::RegisterOf<width>::type;

template <class Register>
[[gnu::always_inline]] inline Register load_register(const double* from) {
    Register r;
    std::memcpy(&r, from, sizeof r);
    return r;
}

}  // namespace orbid::models

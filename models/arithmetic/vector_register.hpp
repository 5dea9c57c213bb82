#pragma once

#include <cstddef>
#include <cstring>
#include <type_traits>

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

/// factor b + c in every lane, rounded once where the machine does so at no cost. By the builtins of GCC and Clang, as
/// their header of all vector instructions takes a quarter of a second to read.
template <class Register>
requires(!std::is_class_v<Register> && !std::is_arithmetic_v<Register>) [[gnu::always_inline]] inline Register
    multiply_add(double factor, const Register& b, const Register& c) {
    const Register a = factor - Register{};
#if defined(__AVX512F__)
    if constexpr (sizeof(Register) == 64) {
        constexpr int present_rounding = 4;
        return __builtin_ia32_vfmaddpd512_mask(a, b, c, static_cast<unsigned char>(-1), present_rounding);
    }
#endif
#if defined(__FMA__)
    if constexpr (sizeof(Register) == 32) return __builtin_ia32_vfmaddpd256(a, b, c);
    if constexpr (sizeof(Register) == 16) return __builtin_ia32_vfmaddpd(a, b, c);
#endif
    return a * b + c;
}

template <class Register>
[[gnu::always_inline]] inline Register load_register(const double* from) {
    Register r;
    std::memcpy(&r, from, sizeof r);
    return r;
}

}  // namespace orbid::models

#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>

#include <xsimd/xsimd.hpp>

/// Sums with one rounding, and sines, of R vector registers of instructions Arch: what Pack computes itself.
namespace orbid::models::detail {

template <class>
inline constexpr bool is_fma3 = false;
template <class Avx>
inline constexpr bool is_fma3<xsimd::fma3<Avx>> = true;

/// Whether the instructions have a b + c with one rounding.
template <class Arch>
inline constexpr bool fused = is_fma3<Arch> || std::is_base_of_v<xsimd::avx512f, Arch>;

/// a b + c with one rounding, where the processor has it. For AVX-512 xsimd 8.1 would multiply and then add.
template <class Arch>
[[gnu::always_inline]] inline xsimd::batch<double, Arch> fused_sum(const xsimd::batch<double, Arch>& a,
                                                                   const xsimd::batch<double, Arch>& b,
                                                                   const xsimd::batch<double, Arch>& c) {
#ifdef __AVX512F__
    if constexpr (std::is_base_of_v<xsimd::avx512f, Arch>) return _mm512_fmadd_pd(a, b, c);
#endif
    return xsimd::fma(a, b, c);
}

/// Adding 1.5 2^52 rounds to a whole number, whose last bits are then those of the sum.
inline constexpr double rounds_to_whole = 0x1.8p52;

/// sin of a (quarter = 0) or of a + pi/2 (quarter = 1), with fused operations.
///
///     a = (k + quarter/2) pi + r,  |r| <= pi/2,   sin(a + quarter pi/2) = (-1)^(k + quarter) sin r
///
/// With fused operations a - k pi_1 has no rounding error: both are multiples of 2^-52, and the difference is below
/// 2. pi_1 + pi_2 is pi but for 3e-33; so close to a multiple k pi the error is 3e-33 k where that exceeds 2 ulp.
/// sin r = r + r^3 P(r^2), P the polynomial of degree 7 with the least relative error on [0, (pi/2)^2], 2.8e-19
/// (exchange algorithm in 50 digits). xsimd reduces by pi/2, evaluates two polynomials and asks all lanes which
/// reduction to take.
template <int quarter, class Arch, std::size_t R>
[[gnu::always_inline]] inline void fused_sine(const xsimd::batch<double, Arch> (&a)[R],
                                              xsimd::batch<double, Arch> (&result)[R]) {
    using Register = xsimd::batch<double, Arch>;
    using Bits = xsimd::batch<std::int64_t, Arch>;
    constexpr double inverse_pi = 0.31830988618379069, pi_1 = 3.1415926535897931, pi_2 = 1.2246467991473532e-16;
    constexpr double p[] = {-0.16666666666666666,    0.0083333333333331944,  -0.00019841269841209072,
                            2.755731921111125e-06,   -2.505210687035718e-08, 1.6058939580014569e-10,
                            -7.6429881393809621e-13, 2.7211389437411986e-15};
    const Register round(rounds_to_whole);
    Register whole[R], turns[R], r[R], square[R], sum[R];
    for (std::size_t i = 0; i < R; ++i) {
        if constexpr (quarter == 0)
            whole[i] = fused_sum(a[i], Register(inverse_pi), round);
        else
            whole[i] = fused_sum(a[i], Register(inverse_pi), Register(-0.5)) + round;
        turns[i] = whole[i] - round;
        if constexpr (quarter == 1) turns[i] = turns[i] + Register(0.5);
    }
    for (std::size_t i = 0; i < R; ++i)
        r[i] = fused_sum(-turns[i], Register(pi_1), a[i]);
    for (std::size_t i = 0; i < R; ++i)
        r[i] = fused_sum(-turns[i], Register(pi_2), r[i]);
    for (std::size_t i = 0; i < R; ++i) {
        square[i] = r[i] * r[i];
        sum[i] = Register(p[7]);
    }
    for (int j = 6; j >= 0; --j)
        for (std::size_t i = 0; i < R; ++i)
            sum[i] = fused_sum(sum[i], square[i], Register(p[j]));
    for (std::size_t i = 0; i < R; ++i) {
        const Register magnitude = fused_sum(sum[i], r[i] * square[i], r[i]);
        Bits sign = xsimd::bitwise_cast<Bits>(whole[i]) << 63;
        if constexpr (quarter == 1) sign = sign ^ Bits(std::numeric_limits<std::int64_t>::min());
        const Register signed_value = xsimd::bitwise_cast<Register>(xsimd::bitwise_cast<Bits>(magnitude) ^ sign);
        // Beyond, the sum has no bits left for the last whole number; all bits set are a nan.
        const auto beyond = !(xsimd::abs(a[i]) <= Register(0x1p50));
        result[i] = xsimd::select(beyond, Register(std::numeric_limits<double>::quiet_NaN()), signed_value);
    }
}

/// Replaces the lanes of result that are marked by sin a, or cos a, of the standard library.
template <int quarter, class Register, class Marks>
[[gnu::noinline, gnu::cold]] void library_sine(const Register& a, const Marks& marked, Register& result) {
    std::array<double, Register::size> argument, value;
    std::array<bool, Register::size> replace;
    a.store_unaligned(argument.data());
    result.store_unaligned(value.data());
    marked.store_unaligned(replace.data());
    for (std::size_t l = 0; l < value.size(); ++l)
        if (replace[l]) value[l] = quarter == 0 ? std::sin(argument[l]) : std::cos(argument[l]);
    result = Register::load_unaligned(value.data());
}

/// sin of a (quarter = 0) or of a + pi/2 (quarter = 1), without fused operations.
///
///     a = k pi/2 + r + rest,  |r| <= pi/4;   +-sin(r + rest) where k + quarter is even, else +-cos(r + rest)
///
/// pi/2 is the sum of four numbers, the first three of 31 bits (W. J. Cody, W. Waite, Software Manual for the
/// Elementary Functions, 1980): products with |k| < 2^22 have no rounding error, and rest holds what the
/// subtractions round away. sin r = r + r^3 P(r^2), cos r = 1 - r^2/2 + r^4 Q(r^2) with the least relative errors on
/// [0, (pi/4)^2], 3.6e-18 and 5.6e-20 (exchange algorithm in 60 digits). Lanes with |a| > 2^22 are left to the
/// standard library.
template <int quarter, class Arch>
[[gnu::always_inline]] inline xsimd::batch<double, Arch> split_sine(const xsimd::batch<double, Arch>& a) {
    using Register = xsimd::batch<double, Arch>;
    using Bits = xsimd::batch<std::int64_t, Arch>;
    constexpr double half_pi_1 = 0x1.921fb544p+0, half_pi_2 = 0x1.0b4611a4p-34, half_pi_3 = 0x1.13198a2cp-65,
                     half_pi_4 = 0x1.01b839a25204ap-96, inverse_half_pi = 0.63661977236758138;
    constexpr double p[] = {-0.1666666666666663,   0.008333333333322118,    -0.00019841269829589495,
                            2.755731362137047e-06, -2.5050747760363917e-08, 1.5896230007059032e-10};
    constexpr double q[] = {0.041666666666666595,    -0.0013888888888873056, 2.4801587288851656e-05,
                            -2.7557314179282176e-07, 2.0875700839943886e-09, -1.135853641364219e-11};
    const Register whole = a * Register(inverse_half_pi) + Register(rounds_to_whole);
    const Register k = whole - Register(rounds_to_whole);

    const Register r_1 = a - k * Register(half_pi_1);
    const Register part_2 = k * Register(half_pi_2);
    const Register r_2 = r_1 - part_2;
    const Register part_3 = k * Register(half_pi_3) - ((r_1 - r_2) - part_2);
    const Register r = r_2 - part_3;
    const Register rest = ((r_2 - r) - part_3) - k * Register(half_pi_4);

    const Register square = r * r;
    Register odd(p[5]), even(q[5]);
    for (int j = 4; j >= 0; --j) {
        odd = odd * square + Register(p[j]);
        even = even * square + Register(q[j]);
    }
    const Register half_square = square * Register(0.5);
    const Register leading = Register(1.0) - half_square;
    const Register sine = r + (r * square * odd + rest * leading);
    const Register cosine = leading + (((Register(1.0) - leading) - half_square) + (square * square * even - r * rest));

    const Bits quadrant = xsimd::bitwise_cast<Bits>(whole) + Bits(quarter);
    // The last bit of the quadrant becomes the sign of a one.
    const auto is_sine =
        xsimd::bitwise_cast<Register>((quadrant << 63) ^ xsimd::bitwise_cast<Bits>(Register(1.0))) > Register(0.0);
    const Bits sign = (quadrant << 62) & Bits(std::numeric_limits<std::int64_t>::min());
    Register result =
        xsimd::bitwise_cast<Register>(xsimd::bitwise_cast<Bits>(xsimd::select(is_sine, sine, cosine)) ^ sign);
    const auto beyond = !(xsimd::abs(a) <= Register(0x1p22));
    if (xsimd::any(beyond)) [[unlikely]]
        library_sine<quarter>(a, beyond, result);
    return result;
}

/// sin of a (quarter = 0) or cos of a (quarter = 1), to 2 ulp in every lane.
template <int quarter, class Arch, std::size_t R>
[[gnu::always_inline]] inline void sine(const xsimd::batch<double, Arch> (&a)[R],
                                        xsimd::batch<double, Arch> (&result)[R]) {
    if constexpr (fused<Arch>)
        fused_sine<quarter>(a, result);
    else
        for (std::size_t i = 0; i < R; ++i)
            result[i] = split_sine<quarter>(a[i]);
}

}  // namespace orbid::models::detail

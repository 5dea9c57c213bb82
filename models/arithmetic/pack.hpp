#pragma once

#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <functional>
#include <limits>

#include <xsimd/xsimd.hpp>

#include "models/arithmetic/pack_sine.hpp"

namespace orbid::models {

/// Numbers that are computed side by side: the scalar of `Pack::width` independent trajectories.
///
/// R registers of the vector instructions that the file is compiled for (Arch). They are used in turn, so that each
/// instruction finds its operands ready. The same model code serves double, Dual and Pack. A lane of a result depends
/// only on the same lane of the arguments. The operations are the same in every lane and for every R, so it makes no
/// difference which trajectories share a pack.
///
/// All is inlined by force. GCC 12 passes packs to functions through memory, in halves of a register. Reading whole
/// what was written in halves stalls the processor (measured: twice the time of a step).
///
/// Comparisons give a Mask, which has no truth value: where a model would branch, it has to call select(). Functions
/// are accurate to 2 ulp, as the tests measure. With fused operations sin and cos of |x| > 2^50 are nan; that
/// trajectory is then computed in plain doubles.
template <std::size_t R, class Arch = xsimd::default_arch>
class Pack {
public:
    using Register = xsimd::batch<double, Arch>;
    using Part = const Register&;
    static constexpr std::size_t registers = R;
    static constexpr std::size_t width = R * Register::size;

    /// One truth value per lane.
    class Mask {
    public:
        using Register = xsimd::batch_bool<double, Arch>;
        [[nodiscard]] bool all() const {
            bool every = true;
            for (std::size_t i = 0; i < R; ++i)
                every = every && xsimd::all(part_[i]);
            return every;
        }
        [[nodiscard]] bool any() const { return !(!*this).all(); }
        [[nodiscard]] std::array<bool, width> lanes() const {
            std::array<bool, width> lanes;
            for (std::size_t i = 0; i < R; ++i)
                part_[i].store_unaligned(lanes.data() + i * Pack::Register::size);
            return lanes;
        }
        [[gnu::always_inline]] friend Mask operator&(Mask a, const Mask& b) {
            for (std::size_t i = 0; i < R; ++i)
                a.part_[i] = a.part_[i] & b.part_[i];
            return a;
        }
        [[gnu::always_inline]] friend Mask operator|(Mask a, const Mask& b) {
            for (std::size_t i = 0; i < R; ++i)
                a.part_[i] = a.part_[i] | b.part_[i];
            return a;
        }
        [[gnu::always_inline]] friend Mask operator!(const Mask& a) {
            Mask r;
            for (std::size_t i = 0; i < R; ++i)
                r.part_[i] = !a.part_[i];
            return r;
        }

        /// Does not exist, as lanes may differ; it only gives the author of a model that branches a message.
        template <std::same_as<bool> B>
        explicit operator B() const {
            static_assert(sizeof(B) == 0,
                          "equations that branch on their numbers cannot be computed in packs: add "
                          "static constexpr bool packs = false (docs/adding_a_model.md)");
            return false;
        }

    private:
        friend class Pack;
        Register part_[R];
    };

    Pack() = default;
    /// The same number in all lanes.
    [[gnu::always_inline]] Pack(double same) {  // NOLINT: implicit, a constant is a number
        for (std::size_t i = 0; i < R; ++i)
            part_[i] = Register(same);
    }
    [[nodiscard, gnu::always_inline]] static Pack load(const double* from) {
        Pack r;
        for (std::size_t i = 0; i < R; ++i)
            r.part_[i] = Register::load_unaligned(from + i * Register::size);
        return r;
    }
    [[gnu::always_inline]] void store(double* to) const {
        for (std::size_t i = 0; i < R; ++i)
            part_[i].store_unaligned(to + i * Register::size);
    }
    [[nodiscard]] std::array<double, width> lanes() const {
        std::array<double, width> lanes;
        store(lanes.data());
        return lanes;
    }

    Pack& operator+=(const Pack& b) { return *this = *this + b; }
    Pack& operator-=(const Pack& b) { return *this = *this - b; }
    Pack& operator*=(const Pack& b) { return *this = *this * b; }
    Pack& operator/=(const Pack& b) { return *this = *this / b; }

    [[gnu::always_inline]] friend Pack operator+(const Pack& a) { return a; }
    [[gnu::always_inline]] friend Pack operator-(const Pack& a) { return each(std::negate<>(), a); }
    [[gnu::always_inline]] friend Pack operator+(const Pack& a, const Pack& b) { return each(std::plus<>(), a, b); }
    [[gnu::always_inline]] friend Pack operator-(const Pack& a, const Pack& b) { return each(std::minus<>(), a, b); }
    [[gnu::always_inline]] friend Pack operator*(const Pack& a, const Pack& b) {
        return each(std::multiplies<>(), a, b);
    }
    [[gnu::always_inline]] friend Pack operator/(const Pack& a, const Pack& b) { return each(std::divides<>(), a, b); }
    /// factor b + c, rounded once where the machine can.
    [[gnu::always_inline]] friend Pack fma(double factor, const Pack& b, const Pack& c) {
        const Register f(factor);
        return each([&f](Part x, Part y) { return detail::fused_sum(f, x, y); }, b, c);
    }
    [[gnu::always_inline]] friend Pack fma(const Pack& a, const Pack& b, const Pack& c) {
        Pack r;
        for (std::size_t i = 0; i < R; ++i)
            r.part_[i] = detail::fused_sum(a.part_[i], b.part_[i], c.part_[i]);
        return r;
    }

    [[gnu::always_inline]] friend Mask operator<(const Pack& a, const Pack& b) {
        return each<Mask>([](Part x, Part y) { return x < y; }, a, b);
    }
    [[gnu::always_inline]] friend Mask operator<=(const Pack& a, const Pack& b) {
        return each<Mask>([](Part x, Part y) { return x <= y; }, a, b);
    }
    [[gnu::always_inline]] friend Mask operator>(const Pack& a, const Pack& b) { return b < a; }
    [[gnu::always_inline]] friend Mask operator>=(const Pack& a, const Pack& b) { return b <= a; }
    [[gnu::always_inline]] friend Mask operator==(const Pack& a, const Pack& b) {
        return each<Mask>([](Part x, Part y) { return x == y; }, a, b);
    }
    [[gnu::always_inline]] friend Mask operator!=(const Pack& a, const Pack& b) { return !(a == b); }
    /// a where the mask holds, b elsewhere.
    [[gnu::always_inline]] friend Pack select(const Mask& mask, const Pack& a, const Pack& b) {
        return each([](const auto& m, Part x, Part y) { return xsimd::select(m, x, y); }, mask, a, b);
    }
    [[gnu::always_inline]] friend Mask isfinite(const Pack& a) {
        return abs(a) <= Pack(std::numeric_limits<double>::max());
    }

    [[gnu::always_inline]] friend Pack abs(const Pack& a) {
        return each([](Part x) { return xsimd::abs(x); }, a);
    }
    [[gnu::always_inline]] friend Pack min(const Pack& a, const Pack& b) {
        return each([](Part x, Part y) { return xsimd::min(x, y); }, a, b);
    }
    [[gnu::always_inline]] friend Pack max(const Pack& a, const Pack& b) {
        return each([](Part x, Part y) { return xsimd::max(x, y); }, a, b);
    }
    /// |a| with the sign of b.
    [[gnu::always_inline]] friend Pack copysign(const Pack& a, const Pack& b) {
        return each([](Part x, Part y) { return xsimd::copysign(x, y); }, a, b);
    }
    [[gnu::always_inline]] friend Pack sqrt(const Pack& a) {
        return each([](Part x) { return xsimd::sqrt(x); }, a);
    }
    [[gnu::always_inline]] friend Pack sin(const Pack& a) { return a.template sine<0>(); }
    [[gnu::always_inline]] friend Pack cos(const Pack& a) { return a.template sine<1>(); }
    [[gnu::always_inline]] friend Pack exp(const Pack& a) {
        return each([](Part x) { return xsimd::exp(x); }, a);
    }
    [[gnu::always_inline]] friend Pack log(const Pack& a) {
        return each([](Part x) { return xsimd::log(x); }, a);
    }
    [[gnu::always_inline]] friend Pack asin(const Pack& a) {
        return each([](Part x) { return xsimd::asin(x); }, a);
    }
    [[gnu::always_inline]] friend Pack acos(const Pack& a) {
        return each([](Part x) { return xsimd::acos(x); }, a);
    }
    [[gnu::always_inline]] friend Pack sinh(const Pack& a) {
        return each([](Part x) { return xsimd::sinh(x); }, a);
    }
    [[gnu::always_inline]] friend Pack cosh(const Pack& a) {
        return each([](Part x) { return xsimd::cosh(x); }, a);
    }
    [[gnu::always_inline]] friend Pack tanh(const Pack& a) {
        return each([](Part x) { return xsimd::tanh(x); }, a);
    }
    [[gnu::always_inline]] friend Pack tan(const Pack& a) {
        return lanewise([](double x) { return std::tan(x); }, a);
    }
    [[gnu::always_inline]] friend Pack atan(const Pack& a) {
        return lanewise([](double x) { return std::atan(x); }, a);
    }
    [[gnu::always_inline]] friend Pack atan2(const Pack& y, const Pack& x) {
        return lanewise([](double u, double v) { return std::atan2(u, v); }, y, x);
    }
    [[gnu::always_inline]] friend Pack pow(const Pack& a, const Pack& b) {
        return lanewise([](double x, double y) { return std::pow(x, y); }, a, b);
    }

private:
    /// f of each register of the operands.
    template <class Result = Pack, class F, class... Operands>
    [[gnu::always_inline]] static Result each(const F& f, const Operands&... operands) {
        Result r;
        for (std::size_t i = 0; i < R; ++i)
            r.part_[i] = f(operands.part_[i]...);
        return r;
    }
    /// Rarely used functions, by the standard library. Those of xsimd 8.1 are wrong by more than 2 ulp (tan 2.5, atan
    /// 2.2, pow 33) or reduce an argument in a way that depends on the other lanes.
    template <class F, class... Packs>
    static Pack lanewise(const F& f, const Packs&... packs) {
        std::array<double, width> result;
        [&](const auto&... lanes) {
            for (std::size_t i = 0; i < width; ++i)
                result[i] = f(lanes[i]...);
        }(packs.lanes()...);
        return load(result.data());
    }

    template <int quarter>
    [[gnu::always_inline]] Pack sine() const {
        Pack result;
        detail::sine<quarter>(part_, result.part_);
        return result;
    }

    Register part_[R];
};

}  // namespace orbid::models

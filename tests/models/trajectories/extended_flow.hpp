#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "models/definition/model.hpp"

namespace orbid::models {

/// One period of a forced model in long double (64 bits), as a reference for all that steps in double.
///
/// 64 steps of the midpoint rule extrapolated to order 18 (Gragg; 2, 4, ... 18 substeps), which no integrator of
/// models/ uses; zeros of the velocity by bisection of the step, sticking by bisection of its end. Against 128 steps of
/// order 20 the states of the chaotic pendulums move by less than 1e-17.
template <ForcedModel M>
class ExtendedFlow {
public:
    using T = long double;
    static constexpr std::size_t n = dimension_of<M>;
    using Point = State<T, n>;

    explicit ExtendedFlow(const Values<double, parameter_count_of<M>>& p) : omega_(p[M::forcing_frequency]) {
        Values<T, parameter_count_of<M>> values;
        std::copy(p.begin(), p.end(), values.begin());
        constants_ = constants_from<M, T>(values);
    }

    /// The state one period after phase 0; angles are not wrapped.
    [[nodiscard]] Point period(const State<double, n>& start) const {
        constexpr T turn = 2.0L * std::numbers::pi_v<T>;
        constexpr int steps = 64;
        Point x;
        std::copy(start.begin(), start.end(), x.begin());
        T side = 1.0L;
        if constexpr (SwitchingModel<M>) side = side_at(x, 0.0L);
        for (int k = 0; k < steps; ++k)
            x = through(x, turn * k / steps, turn * (k + 1) / steps, side);
        return x;
    }

private:
    /// side is 0 while the solution sticks.
    [[nodiscard]] Point through(Point x, T s, T end, T& side) const {
        if constexpr (!SwitchingModel<M>) return step(x, s, end - s, side);
        while (s < end) {
            if (side == 0.0L) {
                s = released(x, s, end, side);
                continue;
            }
            const Point whole = step(x, s, end - s, side);
            if (side * whole[velocity] > 0.0L) return whole;
            // Bisection to the last bit; the first half of a bracket may begin on the surface.
            T before = 0.0L, after = end - s;
            for (T middle = 0.5L * after; before < middle && middle < after; middle = 0.5L * (before + after))
                (side * step(x, s, middle, side)[velocity] > 0.0L ? before : after) = middle;
            x = step(x, s, after, side);
            x[velocity] = 0.0L;
            s += after;
            side = side_at(x, s);
        }
        return x;
    }

    /// To which side a solution leaves velocity 0; 0 when both accelerations point at the surface.
    [[nodiscard]] T side_at(const Point& x, T s) const {
        if (x[velocity] != 0.0L) return x[velocity] < 0.0L ? -1.0L : 1.0L;
        if (slope(x, s, 1.0L)[velocity] > 0.0L) return 1.0L;
        return slope(x, s, -1.0L)[velocity] < 0.0L ? -1.0L : 0.0L;
    }
    [[nodiscard]] T released(const Point& x, T s, T end, T& side) const {
        constexpr int samples = 64;
        for (int i = 1; i <= samples; ++i) {
            T held = s + (end - s) * (i - 1) / samples, free = s + (end - s) * i / samples;
            if (side_at(x, free) == 0.0L) continue;
            for (T middle = 0.5L * (held + free); held < middle && middle < free; middle = 0.5L * (held + free))
                (side_at(x, middle) == 0.0L ? held : free) = middle;
            side = side_at(x, free);
            return free;
        }
        return end;
    }

    [[nodiscard]] Point slope(const Point& x, T s, T side) const {
        Point f;
        if constexpr (SwitchingModel<M>)
            f = M::rhs(s, x, constants_, side);
        else
            f = M::rhs(s, x, constants_);
        for (T& component : f)
            component /= omega_;
        return f;
    }

    [[nodiscard]] Point step(const Point& x, T s, T length, T side) const {
        constexpr std::size_t columns = 9;
        std::array<Point, columns> table;
        for (std::size_t j = 0; j < columns; ++j) {
            const std::size_t substeps = 2 * (j + 1);
            const T h = length / static_cast<T>(substeps);
            Point before = x, now = x, f = slope(x, s, side);
            for (std::size_t c = 0; c < n; ++c)
                now[c] += h * f[c];
            for (std::size_t i = 1; i < substeps; ++i) {
                f = slope(now, s + static_cast<T>(i) * h, side);
                for (std::size_t c = 0; c < n; ++c) {
                    const T next = before[c] + 2.0L * h * f[c];
                    before[c] = now[c];
                    now[c] = next;
                }
            }
            f = slope(now, s + length, side);
            for (std::size_t c = 0; c < n; ++c)
                table[j][c] = 0.5L * (before[c] + now[c] + h * f[c]);
            for (std::size_t i = j; i-- > 0;) {
                const T ratio = static_cast<T>(j + 1) / static_cast<T>(i + 1);
                for (std::size_t c = 0; c < n; ++c)
                    table[i][c] = table[i + 1][c] + (table[i + 1][c] - table[i][c]) / (ratio * ratio - 1.0L);
            }
        }
        return table[0];
    }

    Constants<M, T> constants_;
    T omega_;
};

/// Distance of two states on the circles of the model's angles.
template <Model M>
double distance_to(const double* state, const State<long double, dimension_of<M>>& reference) {
    long double sum = 0.0L;
    for (std::size_t i = 0; i < dimension_of<M>; ++i) {
        long double difference = state[i] - reference[i];
        if (M::coordinates[i].angle) difference = std::remainder(difference, 2.0L * std::numbers::pi_v<long double>);
        sum += difference * difference;
    }
    return static_cast<double>(std::sqrt(sum));
}

}  // namespace orbid::models

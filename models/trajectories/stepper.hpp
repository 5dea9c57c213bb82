#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <numbers>
#include <type_traits>
#include <utility>

#include "models/definition/simulation.hpp"
#include "models/trajectories/explicit_method.hpp"
#include "models/trajectories/field.hpp"

namespace orbid::models {

/// The method of all flows.
inline constexpr const auto& flow_method = verner98;

/// One step of flow_method, on values with N directions of derivative.
///
/// The method is linear in the stages, with real coefficients, so values and partials are stepped as one flat array of
/// doubles. The values go through the same operations whatever N is.
template <Model M, std::size_t N, std::size_t order = 1>
class Stepper {
public:
    using T = Scalar<N, order>;
    static constexpr std::size_t n = dimension_of<M>;
    using Point = State<T, n>;

    /// @param field  dx/ds = field(x, s)
    /// @param low    what the rounding of x has lost so far; becomes what that of `end` has lost (Kahan's sum)
    /// @param error  estimated local error, of the derivatives too
    template <class F>
    void step(const F& field, const Point& x, Point& low, const Point& slope, double s, double ds, Point& end,
              Point& error) const {
        Slopes slopes;
        slopes[0] = flat(slope);
        const Flat start = flat(x);
        stages(field, start, slopes, s, ds, std::make_index_sequence<method.stages>{});
        Flat sum = combination<Weights>(slopes), rest = flat(low), stop;
        for (std::size_t k = 0; k < size; ++k) {
            // Two sums: the step plus the earlier rounding error, then the state plus that; exact but for the first
            // rounding.
            const double change = multiply_add(ds, sum[k], rest[k]);
            stop[k] = start[k] + change;
            const double taken = stop[k] - start[k];
            rest[k] = (start[k] - (stop[k] - taken)) + (change - taken);
        }
        end = point(stop);
        low = point(rest);
        sum = combination<Error>(slopes);
        for (double& component : sum)
            component *= ds;
        error = point(sum);
    }

    /// A single step without memory.
    template <class F>
    void step(const F& field, const Point& x, const Point& slope, double s, double ds, Point& end, Point& error) const {
        Point low{};
        step(field, x, low, slope, s, ds, end, error);
    }

    /// The end of a step that starts and ends at instants which depend on the directions.
    template <class F>
    [[nodiscard]] Point moved(const F& field, const Point& x, const T& s, const T& ds) const {
        std::array<Point, method.stages> slopes;
        dual_stages(field, x, slopes, s, ds, std::make_index_sequence<method.stages>{});
        return moved_by<Weights>(x, slopes, ds);
    }

private:
    static constexpr const auto& method = flow_method;
    /// Doubles of a point, padded to whole vectors of four: the padding stays 0.
    static constexpr std::size_t doubles = sizeof(Point) / sizeof(double);
    static constexpr std::size_t size = doubles < 3 ? doubles : (doubles + 3) / 4 * 4;
    struct alignas(size < 3 ? 16 : 32) Flat : std::array<double, size> {};
    using Slopes = std::array<Flat, method.stages>;
    static_assert(sizeof(Point) == doubles * sizeof(double) && std::is_trivially_copyable_v<Point>);

    /// Partials first, each coordinate's together, then all values: what is stored in one vector is read in one. Where
    /// a read straddles two stores, the processor waits until both are in memory.
    static constexpr bool apart = N > 0 && order == 1;

    static Flat flat(const Point& x) {
        Flat f;
        if constexpr (apart) {
            for (std::size_t c = 0; c < n; ++c) {
                std::memcpy(&f[c * N], x[c].partial.data(), N * sizeof(double));
                f[n * N + c] = x[c].value;
            }
        } else {
            std::memcpy(f.data(), x.data(), sizeof(x));
        }
        for (std::size_t k = doubles; k < size; ++k)
            f[k] = 0.0;
        return f;
    }
    static Point point(const Flat& f) {
        Point x;
        if constexpr (apart) {
            for (std::size_t c = 0; c < n; ++c) {
                x[c].value = f[n * N + c];
                std::memcpy(x[c].partial.data(), &f[c * N], N * sizeof(double));
            }
        } else {
            std::memcpy(static_cast<void*>(x.data()), f.data(), sizeof(x));
        }
        return x;
    }

    // The rows of the method, as compile-time functions of the stage.
    template <std::size_t i>
    struct Row {
        static constexpr std::size_t count = i;
        static constexpr double at(std::size_t j) { return method.matrix[i][j]; }
    };
    struct Weights {
        static constexpr std::size_t count = method.stages;
        static constexpr double at(std::size_t j) { return method.weights[j]; }
    };
    struct Error {
        static constexpr std::size_t count = method.stages;
        static constexpr double at(std::size_t j) { return method.error[j]; }
    };

    /// sum_j row_j k_j, zeros left out.
    template <class R>
    static Flat combination(const Slopes& slopes) {
        Flat sum;
        for (std::size_t k = 0; k < size; ++k)
            sum[k] = weighted<R>([&](std::size_t j) { return slopes[j][k]; });
        return sum;
    }
    template <class R, class Get>
    [[gnu::always_inline]] static auto weighted(const Get& slope) {
        return [&]<std::size_t... j>(std::index_sequence<j...>) {
            auto sum = R::at(0) * slope(0);
            ((sum = term<R, j + 1>(slope, sum)), ...);
            return sum;
        }
        (std::make_index_sequence<R::count - 1>{});
    }
    template <class R, std::size_t j, class Get, class Sum>
    [[gnu::always_inline]] static Sum term(const Get& slope, const Sum& sum) {
        if constexpr (R::at(j) != 0.0)
            return multiply_add(R::at(j), slope(j), sum);
        else
            return sum;
    }

    template <class F, std::size_t... i>
    static void stages(const F& field, const Flat& start, Slopes& slopes, double s, double ds,
                       std::index_sequence<0, i...>) {
        (stage<i>(field, start, slopes, s, ds), ...);
    }
    template <std::size_t i, class F>
    static void stage(const F& field, const Flat& start, Slopes& slopes, double s, double ds) {
        Flat at = combination<Row<i>>(slopes);
        for (std::size_t k = 0; k < size; ++k)
            at[k] = multiply_add(ds, at[k], start[k]);
        if constexpr (N == 0)
            slopes[i] = flat(field(point(at), s + method.nodes[i] * ds));
        else
            evaluate(field, at, s + method.nodes[i] * ds, slopes[i]);
    }
    /// One copy of the equations per number of directions instead of one per stage: a sixth less compile time, and
    /// three per cent less at run time. For plain numbers it is eight per cent more.
    template <class F>
    [[gnu::noinline, gnu::flatten]] static void evaluate(const F& field, const Flat& at, double s, Flat& slope) {
        slope = flat(field(point(at), s));
    }

    template <class R>
    static Point moved_by(const Point& x, const std::array<Point, method.stages>& slopes, const T& ds) {
        Point end;
        for (std::size_t c = 0; c < n; ++c)
            end[c] = x[c] + ds * weighted<R>([&](std::size_t j) { return slopes[j][c]; });
        return end;
    }
    template <class F, std::size_t... i>
    static void dual_stages(const F& field, const Point& x, std::array<Point, method.stages>& slopes, const T& s,
                            const T& ds, std::index_sequence<0, i...>) {
        slopes[0] = field(x, s);
        (evaluate(field, moved_by<Row<i>>(x, slopes, ds), s + method.nodes[i] * ds, slopes[i]), ...);
    }
    template <class F>
    [[gnu::noinline]] static void evaluate(const F& field, const Point& at, const T& s, Point& slope) {
        slope = field(at, s);
    }
};

/// Largest ratio of estimated to allowed local error.
///
/// Values: allowed = absolute + relative |x|. An angle counts with at most pi: many turns must not loosen the
/// tolerance. Derivatives with respect to the start (the first n directions, when any are carried): allowed = 10
/// relative (largest entry of their column, at least 1). Near an equilibrium, and on an orbit such as phi = 0, the
/// values alone would allow any step. With them the multipliers of the hanging pendulum were wrong in the third digit.
template <Model M, std::size_t N, std::size_t order = 1>
double error_ratio(const State<Scalar<N, order>, dimension_of<M>>& error,
                   const State<Scalar<N, order>, dimension_of<M>>& start,
                   const State<Scalar<N, order>, dimension_of<M>>& end, const FlowOptions& options,
                   const M& model = M()) {
    constexpr std::size_t n = dimension_of<M>;
    double worst = 0.0;
    const auto judge = [&worst](double size, double allowed) {
        const double ratio = std::abs(size) / allowed;
        // nan must count as a failed step: max(worst, nan) would drop it.
        if (!(ratio <= worst)) worst = std::isnan(ratio) ? std::numeric_limits<double>::infinity() : ratio;
    };
    for (std::size_t i = 0; i < n; ++i) {
        double size = std::max(std::abs(value_of(start[i])), std::abs(value_of(end[i])));
        if (model.coordinates[i].angle) size = std::min(size, std::numbers::pi);
        judge(value_of(error[i]), options.absolute_tolerance + options.relative_tolerance * size);
    }
    if constexpr (N >= n) {
        for (std::size_t j = 0; j < n; ++j) {
            double size = 1.0;
            for (std::size_t i = 0; i < n; ++i)
                size = std::max(size, std::abs(first_order(end[i]).partial[j]));
            for (std::size_t i = 0; i < n; ++i)
                judge(first_order(error[i]).partial[j], 10.0 * options.relative_tolerance * size);
        }
    }
    return worst;
}

template <std::size_t N, std::size_t n, class T>
State<double, n> values_of(const State<T, n>& x) {
    State<double, n> v;
    for (std::size_t i = 0; i < n; ++i)
        v[i] = value_of(x[i]);
    return v;
}

}  // namespace orbid::models

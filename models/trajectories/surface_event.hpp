#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>

#include "models/trajectories/surface_field.hpp"

namespace orbid::models {

/// What happens to a solution at a switching surface: the times of events as dual numbers (M5), and whether a surface
/// is touched only. Decisions are made by the field on values alone.
template <SurfaceModel M, std::size_t N, std::size_t order = 1>
class SurfaceEvent {
public:
    using T = Scalar<N, order>;
    static constexpr std::size_t n = dimension_of<M>;
    static constexpr std::size_t m = surface_count_of<M>;
    using Point = State<T, n>;
    using Plain = State<double, n>;

    /// x a time ds later, where ds has the value 0.
    template <class F>
    static Point shifted(const F& field, const Point& x, const T& s, const T& ds) {
        if constexpr (order == 1) {
            const Point f = field(x, value_of(s));
            Point end;
            for (std::size_t i = 0; i < n; ++i)
                end[i] = x[i] + f[i] * ds;
            return end;
        } else {
            return Stepper<M, N, order>().moved(field, x, s, ds);
        }
    }

    /// How much later surface j is met, with the value 0: Newton steps of h in dual arithmetic, one for each order of
    /// derivative.
    /// @param rate  of h there
    template <class F>
    static T crossing_time(const F& field, const Point& x, double at, std::size_t j, double rate) {
        T later(0.0);
        for (std::size_t newton = 0; newton < order; ++newton) {
            const T h = field.surfaces(shifted(field, x, T(at), later), at + later)[j];
            later = later - h / rate;
            later = later - value_of(later);
        }
        return later;
    }

    /// How much later a sliding solution is released to the side +1 (`up`) or -1; nothing where it grazes.
    /// @param values  the sliding field without derivatives
    /// @param probe   a short time
    template <class F>
    static std::optional<T> release_time(const F& field, const SurfaceField<M, 0>& values, const Point& x, double at,
                                         bool up, double probe) requires(order == 2) {
        const Plain arrival = values_of<N, n>(x);
        const auto slope = values(arrival, at);
        const auto pull = [&](const auto& sliding, const auto& y, const auto& s) {
            const auto halves = sliding.halves(y, s);
            return up ? halves.first.rate : halves.second.rate;
        };
        const auto pull_at = [&](double ahead) {
            auto y = arrival;
            for (std::size_t i = 0; i < n; ++i)
                y[i] += ahead * slope[i];
            return pull(values, y, at + ahead);
        };
        const double rate = (pull_at(probe) - pull_at(-probe)) / (2.0 * probe);
        if (!(std::abs(rate) > 0.0)) return std::nullopt;
        T later(0.0);
        // The rate is a difference quotient, accurate to 1e-8: three steps eliminate its error.
        for (int newton = 0; newton < 3; ++newton) {
            later = later - pull(field, shifted(field, x, T(at), later), at + later) / rate;
            later = later - value_of(later);
        }
        return later;
    }

    /// True where the solution arrives on a surface without crossing it, while the field or the state jumps there.
    /// Rounding would decide whether it is met, and the instant cannot be determined.
    static bool touches(const SurfaceField<M, 0>& values, const Plain& x, std::size_t j, double at, double rate,
                        double probe) {
        const double arriving = values.side[j] * rate;
        Side<M> other = values.side;
        other[j] = -other[j];
        if (!impacts_of<M>()[j]) {
            const auto here = values.one_sided(x, at, values.side), there = values.one_sided(x, at, other);
            double jump = 0.0, size = 0.0;
            for (std::size_t i = 0; i < n; ++i) {
                jump = std::max(jump, std::abs(there[i] - here[i]));
                size = std::max(size, std::abs(there[i]) + std::abs(here[i]));
            }
            // A field that is continuous there, up to rounding, is the same for touching and crossing.
            if (jump <= 1e-14 * size) return false;
            // 1e-8 of the jump of the rate: half of the digits.
            const double opposed =
                values.side[j] * (values.moving(x, there, at)[j].partial[0] - values.moving(x, here, at)[j].partial[0]);
            if (opposed > 0.0 && !(arriving < -1e-8 * opposed)) return true;
        }
        if (!(arriving < 0.0)) return true;
        // The depth the solution would reach behind the surface, against the rounding of h.
        const auto rate_at = [&](double ahead) {
            const auto f = values(x, at);
            auto y = x;
            for (std::size_t i = 0; i < n; ++i)
                y[i] += ahead * f[i];
            return values.moving(y, values(y, at + ahead), at + ahead)[j].partial[0];
        };
        const double turning = values.side[j] * (rate_at(probe) - rate_at(-probe)) / (2.0 * probe);
        return turning > 0.0 && arriving * arriving <= 2.0 * turning * rounding_of(values, x, j, at);
    }

private:
    /// Rounding of h_j: some units in the last place of its terms.
    static double rounding_of(const SurfaceField<M, 0>& values, const Plain& x, std::size_t j, double at) {
        using Gradient = Dual<n + 1>;
        State<Gradient, n> y;
        for (std::size_t i = 0; i < n; ++i)
            y[i] = Gradient::variable(x[i], i);
        const double t = values.time(at);
        const auto h = values.model.surfaces(Gradient::variable(t, n), y, constants_as<Gradient>(values.constants))[j];
        double terms = std::abs(h.partial[n] * t);
        for (std::size_t i = 0; i < n; ++i)
            terms += std::abs(h.partial[i] * x[i]);
        return 8.0 * std::numeric_limits<double>::epsilon() * terms;
    }
};

}  // namespace orbid::models

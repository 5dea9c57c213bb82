#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>

#include "models/arithmetic/cubic_zero.hpp"
#include "models/trajectories/stepper.hpp"

namespace orbid::models {

/// Looks into a step of a switching model: where the velocity first changes its sign. On values alone, which are the
/// same for every number of directions.
template <SwitchingModel M>
class VelocityWatch {
public:
    static constexpr std::size_t n = dimension_of<M>;

    struct Meeting {
        std::optional<double> at;  ///< ds of the first meeting
        bool wrong_side = false;   ///< the motion begins to the other side
    };

    /// A step from x at s. The field must outlive this object.
    VelocityWatch(const Field<M, 0>& field, const State<double, n>& x, const State<double, n>& slope, double s)
        : field_(field), x_(x), slope_(slope), s_(s) {}

    /// @param ds         length of the step
    /// @param end        state at its end
    /// @param end_slope  end_slope(): dx/ds there, asked for only where it matters
    template <class Slope>
    [[nodiscard]] Meeting meeting_within(double ds, const State<double, n>& end, const Slope& end_slope) const {
        const double side = field_.side;
        const double v0 = side * x_[velocity], v1 = side * end[velocity];
        // Slopes at both ends belong to steps anyway: this one's and the next one's.
        const double a0 = side * slope_[velocity];
        if (v1 < 0.0) {
            double lo = 0.0;
            if (!(v0 > 0.0)) {
                // The step began on the surface. Look for a point on the right side before the end.
                if (!(a0 > 0.0)) return {std::nullopt, true};
                const auto speed = [&](double at) { return side * after(at)[velocity]; };
                // 2^-40 of a step: the velocity there is below the rounding of the position.
                for (lo = 0.5 * ds; lo > ds * 0x1p-40 && !(speed(lo) > 0.0);)
                    lo *= 0.5;
                if (!(speed(lo) > 0.0)) return {std::nullopt, true};
            }
            const double a1 = side * value_of(end_slope()[velocity]);
            return {zero_of_speed(lo, ds, cubic_zero(v0, v1, a0 * ds, a1 * ds) * ds), false};
        }
        if (!(v0 > 0.0 && (a0 < 0.0 || v1 == 0.0))) return {};
        const double a1 = side * value_of(end_slope()[velocity]);
        if (v1 == 0.0 && a1 < 0.0) return {ds, false};
        if (!(a0 < 0.0 && a1 > 0.0)) return {};
        // Slower in between than at both ends: two crossings may hide in this step. The tangents bound the dip of a
        // convex curve. Only a dip that may reach half of the smaller end is examined.
        const double tangents_meet = (v1 - v0 - a1 * ds) / (a0 - a1);
        const double bound = v0 + a0 * std::clamp(tangents_meet, 0.0, ds);
        if (bound > 0.5 * std::min(v0, v1)) return {};
        double lo = 0.0, hi = ds;
        for (int i = 0; i < 50 && hi - lo > 1e-12 * ds; ++i) {
            const double middle = 0.5 * (lo + hi);
            const State<double, n> x = after(middle);
            if (side * x[velocity] < 0.0) return {zero_of_speed(0.0, middle, 0.5 * middle), false};
            (side * field_(x, s_ + middle)[velocity] < 0.0 ? lo : hi) = middle;
        }
        return {};
    }

private:
    [[nodiscard]] State<double, n> after(double ds) const {
        State<double, n> end, error;
        Stepper<M, 0>().step(field_, x_, slope_, s_, ds, end, error);
        return end;
    }

    /// Zero of the velocity between lo (right side of the surface) and hi (wrong side), to machine accuracy: Newton's
    /// method on the length of the step, held inside the bracket by bisection.
    [[nodiscard]] double zero_of_speed(double lo, double hi, double guess) const {
        const double step = hi;
        double at = guess > lo && guess < hi ? guess : 0.5 * (lo + hi);
        // Newton needs about three; 200 is what bisection alone may need to shrink any bracket to neighbouring doubles.
        for (int i = 0; i < 200; ++i) {
            const State<double, n> x = after(at);
            const double v = field_.side * x[velocity];
            if (v == 0.0) break;
            (v > 0.0 ? lo : hi) = at;
            double next = at - v / (field_.side * field_(x, s_ + at)[velocity]);
            if (!(next > lo && next < hi)) next = 0.5 * (lo + hi);
            // A correction of 1e-8 of the step leaves an error of its square.
            const bool settled = std::abs(next - at) <= 1e-8 * step;
            at = next;
            if (settled) break;
        }
        return at;
    }

    const Field<M, 0>& field_;
    State<double, n> x_, slope_;
    double s_;
};

}  // namespace orbid::models

#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "models/trajectories/stepper.hpp"

namespace orbid::models {

/// Accelerations at velocity 0 on both sides of the switching surface, in the units of the field's clock. The friction
/// opposes the motion: positive <= negative, and the distance is the jump.
struct SurfaceAccelerations {
    double positive;  ///< on the side of positive velocity
    double negative;

    /// Both point at the surface, so that the solution sticks (Filippov).
    [[nodiscard]] bool hold() const { return positive <= 0.0 && negative >= 0.0 && negative > positive; }
    /// > 0 when the surface is left; its zero is the end of sticking.
    [[nodiscard]] double pull() const { return std::max(positive, -negative); }
};

template <SwitchingModel M>
SurfaceAccelerations surface_accelerations(const Field<M, 0>& field, const State<double, 2>& x, double s) {
    const State<double, 2> at_surface{x[0], 0.0};
    return {field(at_surface, s, 1.0)[velocity], field(at_surface, s, -1.0)[velocity]};
}

/// When sticking ends, and to which side.
struct Release {
    double s;
    double side;
};

/// First s in (from, until] at which a state held at velocity 0 is released: |force| exceeds the dry friction.
///
/// The state does not move, so the pull is a function of the phase alone. It is sampled over at most one period of the
/// forcing, or over the present piece of a measured input that [from, until] lies on (neither: held forever). The first
/// rise above 0 is bisected to the last digit. Between samples, maxima near 0 are refined.
template <SwitchingModel M>
std::optional<Release> release_after(const Field<M, 0>& field, const State<double, 2>& x, double from, double until) {
    if constexpr (!ForcedModel<M> && !InputModel<M>) {
        return std::nullopt;
    } else {
        // The forcing of a mechanism has a few harmonics; 128 samples resolve the twentieth with six points each. A
        // piece of a measured input is a cubic.
        constexpr int samples = ForcedModel<M> ? 128 : 8;
        double period = until - from;
        if constexpr (ForcedModel<M>)
            period = 2.0 * std::numbers::pi / (field.clock == Clock::phase ? 1.0 : value_of(field.omega));
        const double end = std::min(until, from + period);
        const double spacing = period / samples;
        const auto pull = [&](double s) { return surface_accelerations(field, x, s).pull(); };
        const auto released = [&](double held, double free) {
            // Bisection: the bracket shrinks to neighbouring doubles, whatever the shape of the pull.
            for (double middle = 0.5 * (held + free); held < middle && middle < free; middle = 0.5 * (held + free))
                (pull(middle) > 0.0 ? free : held) = middle;
            const auto at = surface_accelerations(field, x, free);
            return Release{free, at.positive > 0.0 ? 1.0 : -1.0};
        };
        double s0 = from, r0 = pull(from);
        double before = r0;  // pull one sample before s0
        double s_before = from;
        while (s0 < end) {
            // The end of a short piece: rounding must not stop the samples before it.
            const double s1 = s0 + spacing > s0 ? std::min(s0 + spacing, end) : end;
            const double r1 = pull(s1);
            if (r1 > 0.0) return released(s0, s1);
            // A maximum near s0 that the samples may have missed: golden section where the samples are close to 0. The
            // error of a parabola through them is less than a hundredth of their spread.
            if (r0 >= before && r0 >= r1 && r0 > -(2.0 * r0 - before - r1)) {
                double lo = s_before, hi = s1;
                const double golden = 0.5 * (std::sqrt(5.0) - 1.0);
                for (int i = 0; i < 80 && hi - lo > 1e-14 * period; ++i) {
                    const double left = hi - golden * (hi - lo), right = lo + golden * (hi - lo);
                    if (pull(left) > 0.0) return released(std::max(from, s_before), left);
                    if (pull(left) < pull(right))
                        lo = left;
                    else
                        hi = right;
                }
            }
            s_before = s0;
            before = r0;
            s0 = s1;
            r0 = r1;
        }
        return std::nullopt;
    }
}

}  // namespace orbid::models

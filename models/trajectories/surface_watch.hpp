#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>

#include "models/arithmetic/cubic_zero.hpp"
#include "models/trajectories/surface_field.hpp"

namespace orbid::models {

/// Finds where a step first meets a switching surface, or is released by one.
///
/// It watches numbers that are > 0 until their event: side_j h_j for every surface except the holding one. For that one
/// they are the rates with which the two one-sided fields point at it.
template <SurfaceModel M>
class SurfaceWatch {
public:
    static constexpr std::size_t n = dimension_of<M>;
    static constexpr std::size_t m = surface_count_of<M>;
    static constexpr std::size_t released_up = m, released_down = m + 1, events = m + 2;
    using Point = State<double, n>;
    using Marks = std::array<bool, events>;

    struct Sample {
        double value;
        double rate;
    };
    using Samples = std::array<Sample, events>;

    /// A step of the present field, without derivatives.
    struct Step {
        double s;
        double length;
        Point start, start_slope;
        Point end, end_slope;
    };

    struct Outcome {
        std::optional<double> at;         ///< length of the step to the first event
        std::size_t event = events;       ///< which one
        std::optional<std::size_t> lost;  ///< the step began on this surface and does not get away from it
        bool too_long = false;            ///< a watched number turns around within the step, unseen at its ends
    };

    /// @param field  sides and what is held, as during the step
    /// @param begun  events at which the step begins: they cannot happen again before their number has been > 0
    /// @param check_length  false: never too_long
    [[nodiscard]] Outcome first_event(const SurfaceField<M, 0>& field, Step step, const Marks& begun,
                                      bool check_length) const {
        Outcome outcome;
        // Rates of rates are taken by central differences over this part of the step; they only guide searches.
        const double probe = 1e-4 * step.length;
        const Samples first = samples(field, step.start, step.start_slope, step.s, probe);
        Samples last = samples(field, step.end, step.end_slope, step.s + step.length, probe);
        if (check_length)
            for (std::size_t e = 0; e < events; ++e)
                if (watched(field, e) && turns_unseen(field, e, step, first[e], last[e])) outcome.too_long = true;
        if (outcome.too_long) return outcome;
        for (std::size_t e = 0; e < events; ++e) {
            if (!watched(field, e)) continue;
            if (!(first[e].value > 0.0) && !begun[e]) {
                // Already behind the surface: two were met at once. Or leaving it by itself.
                if (first[e].rate > 0.0) continue;
                return {0.0, e, std::nullopt, false};
            }
            const auto [at, lost] = event_within(field, e, step, first[e], last[e]);
            if (lost) outcome.lost = e;
            if (!at) continue;
            outcome.at = at;
            outcome.event = e;
            // The others matter only if they come earlier.
            if (*at < step.length) {
                step.end = after(field, step, *at);
                step.length = *at;
                step.end_slope = field(step.end, step.s + step.length);
                last = samples(field, step.end, step.end_slope, step.s + step.length, probe);
            }
        }
        if (outcome.at) outcome.lost.reset();
        return outcome;
    }

    /// Which numbers are > 0.
    [[nodiscard]] Marks positive(const SurfaceField<M, 0>& field, const Point& x, double s) const {
        Marks marks{};
        const Samples now = samples(field, x, field(x, s), s, 0.0);
        for (std::size_t e = 0; e < events; ++e)
            marks[e] = now[e].value > 0.0;
        return marks;
    }

private:
    static bool watched(const SurfaceField<M, 0>& field, std::size_t e) {
        return e < m ? e != field.held : field.held < m;
    }

    Samples samples(const SurfaceField<M, 0>& field, const Point& x, const Point& f, double s, double probe) const {
        Samples all{};
        const auto h = field.moving(x, f, s);
        for (std::size_t j = 0; j < m; ++j)
            all[j] = {field.side[j] * h[j].value, field.side[j] * h[j].partial[0]};
        if (field.held < m) {
            const auto pull = [&](double ahead) {
                Point y = x;
                for (std::size_t i = 0; i < n; ++i)
                    y[i] += ahead * f[i];
                const auto [up, down] = field.halves(y, s + ahead);
                return std::array{-up.rate, down.rate};
            };
            const auto now = pull(0.0);
            std::array<double, 2> rate{};
            if (probe > 0.0) {
                const auto before = pull(-probe), later = pull(probe);
                for (std::size_t i = 0; i < 2; ++i)
                    rate[i] = (later[i] - before[i]) / (2.0 * probe);
            }
            all[released_up] = {now[0], rate[0]};
            all[released_down] = {now[1], rate[1]};
        }
        return all;
    }
    Sample sample(const SurfaceField<M, 0>& field, std::size_t e, const Step& step, double at) const {
        const Point x = after(field, step, at);
        return samples(field, x, field(x, step.s + at), step.s + at, e < m ? 0.0 : 1e-4 * step.length)[e];
    }

    /// State a part of the step after its start.
    Point after(const SurfaceField<M, 0>& field, const Step& step, double length) const {
        if (length == 0.0) return step.start;
        Point end, error;
        stepper_.step(field, step.start, step.start_slope, step.s, length, end, error);
        return end;
    }

    /// State in between by the cubic through both ends: cheap, and accurate enough to guide the search.
    static Point between(const Step& step, double part) {
        Point x;
        for (std::size_t i = 0; i < n; ++i)
            x[i] = cubic(step.start[i], step.end[i], step.length * step.start_slope[i], step.length * step.end_slope[i],
                         part);
        return x;
    }
    static double cubic(double v0, double v1, double a0, double a1, double part) {
        const double c2 = 3.0 * (v1 - v0) - 2.0 * a0 - a1, c3 = 2.0 * (v0 - v1) + a0 + a1;
        return v0 + part * (a0 + part * (c2 + part * c3));
    }
    static constexpr std::array<double, 3> parts{0.25, 0.5, 0.75};

    /// A number that depends on time or state differently from the solution itself. The step may be long for it where
    /// it is short for the solution (a constant state under a surface that moves).
    bool turns_unseen(const SurfaceField<M, 0>& field, std::size_t e, const Step& step, const Sample& first,
                      const Sample& last) const {
        const double a0 = step.length * first.rate, a1 = step.length * last.rate;
        const double size = std::max({std::abs(last.value - first.value), std::abs(a0), std::abs(a1)});
        for (const double part : parts) {
            const double expected = cubic(first.value, last.value, a0, a1, part);
            const double found = watched_at(field, e, step, part);
            // A tenth: a sine passes over about 3 rad. Numbers far from 0 are not checked.
            const double error = std::abs(found - expected);
            if (error > 0.1 * size && error > 0.1 * std::min(std::abs(found), std::abs(expected))) return true;
        }
        return false;
    }
    double watched_at(const SurfaceField<M, 0>& field, std::size_t e, const Step& step, double part) const {
        const Point x = between(step, part);
        const double s = step.s + part * step.length;
        if (e < m) return field.side[e] * field.surfaces(x, s)[e];
        const auto [up, down] = field.halves(x, s);
        return e == released_up ? -up.rate : down.rate;
    }

    struct Found {
        std::optional<double> at;
        bool lost = false;
    };
    Found event_within(const SurfaceField<M, 0>& field, std::size_t e, const Step& step, const Sample& first,
                       const Sample& last) const {
        const double length = step.length;
        const double a0 = length * first.rate, a1 = length * last.rate;
        if (!(first.value > 0.0)) {
            // The step begins on the surface. If it ends behind it, look for a point before it in between.
            if (last.value > 0.0) return {};
            const double peak = peak_of_cubic(first.value, last.value, a0, a1) * length;
            double lo = peak;
            if (!(peak > 0.0 && sample(field, e, step, peak).value > 0.0))
                // 2^-60 of a step: shorter intervals cannot be resolved.
                for (lo = 0.5 * length; lo > length * 0x1p-60 && !(sample(field, e, step, lo).value > 0.0);)
                    lo *= 0.5;
            if (lo > length * 0x1p-60) return {zero_between(field, e, step, lo, length, 0.5 * (lo + length))};
            return {std::nullopt, !(last.rate > 0.0)};
        }
        if (last.value < 0.0 || (last.value == 0.0 && last.rate < 0.0)) {
            const double guess = falling_cubic_zero(first.value, last.value, a0, a1);
            return {zero_between(field, e, step, 0.0, length, guess * length)};
        }
        for (const double part : parts)
            if (watched_at(field, e, step, part) < 0.0 && sample(field, e, step, part * length).value < 0.0)
                return {zero_between(field, e, step, 0.0, part * length, 0.5 * part * length)};
        // Smaller in between than at both ends: two events may hide in this step. The tangents bound the dip of a
        // convex curve. Only a dip that may reach half of the smaller end is examined.
        if (!(a0 < 0.0 && a1 > 0.0)) return {};
        const double tangents_meet = (last.value - first.value - a1) / (a0 - a1);
        const double bound = first.value + a0 * std::clamp(tangents_meet, 0.0, 1.0);
        if (bound > 0.5 * std::min(first.value, last.value)) return {};
        double lo = 0.0, hi = length;
        for (int i = 0; i < 50 && hi - lo > 1e-12 * length; ++i) {
            const double middle = 0.5 * (lo + hi);
            const Sample at = sample(field, e, step, middle);
            if (at.value < 0.0) return {zero_between(field, e, step, 0.0, middle, 0.5 * middle)};
            (at.rate < 0.0 ? lo : hi) = middle;
        }
        return {};
    }

    /// Where the cubic with these end values and slopes, rising at 0, has its maximum; 0 where it has none in (0, 1).
    static double peak_of_cubic(double v0, double v1, double a0, double a1) {
        const double c2 = 3.0 * (v1 - v0) - 2.0 * a0 - a1, c3 = 2.0 * (v0 - v1) + a0 + a1;
        const double root = std::sqrt(c2 * c2 - 3.0 * a0 * c3);
        const double peak = a0 / (root - c2);
        return peak > 0.0 && peak < 1.0 ? peak : 0.0;
    }

    /// Zero between lo (> 0 there) and hi (not), to machine accuracy: Newton's method on the length of the step, held
    /// inside the bracket by bisection. A release is returned on its far side, where the field leaves the surface.
    double zero_between(const SurfaceField<M, 0>& field, std::size_t e, const Step& step, double lo, double hi,
                        double guess) const {
        double at = guess > lo && guess < hi ? guess : 0.5 * (lo + hi);
        // Newton needs about four; 200 is what bisection alone may need to shrink any bracket to neighbouring doubles.
        for (int i = 0; i < 200; ++i) {
            const Sample now = sample(field, e, step, at);
            if (now.value == 0.0 && e < m) break;
            (now.value > 0.0 ? lo : hi) = at;
            double next = at - now.value / now.rate;
            if (!(next > lo && next < hi)) next = 0.5 * (lo + hi);
            const bool settled = std::abs(next - at) <= 4e-16 * hi || next == at;
            at = next;
            if (settled) break;
        }
        if (e >= m)
            // From one unit of rounding on, doubled until the number has changed sign.
            for (double more = 2e-16 * step.length; at < hi && sample(field, e, step, at).value > 0.0; more *= 2.0)
                at = std::min(at + more, hi);
        return at;
    }

    Stepper<M, 0> stepper_;
};

}  // namespace orbid::models

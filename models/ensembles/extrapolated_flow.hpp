#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <span>
#include <utility>

#include "models/ensembles/flow_field.hpp"
#include "models/system/kernel.hpp"
#include "models/system/stopped.hpp"
#include "models/trajectories/flow.hpp"

namespace orbid::models {

/// A method of order 16 for one smooth solution: a step H by the explicit midpoint rule in eight sequences of substeps
/// h = H / count,
///
///     z_1 = z_0 + h f(z_0),   z_{m+1} = z_{m-1} + 2 h f(z_m),   m = 1 ... count - 1
///
/// whose ends have errors in even powers of h, and Richardson's extrapolation of them to h = 0. Source: Hairer,
/// Norsett, Wanner, Solving Ordinary Differential Equations I, II.9.
///
/// With counts of 2 ... 16 steps are two thirds as long. The weights have an absolute sum of 1007; larger counts have
/// larger ones, whose rounding shows at tolerances of 1e-11.
struct Extrapolation {
    static constexpr std::size_t sequences = 8;
    static constexpr std::array<std::size_t, sequences> counts{8, 10, 12, 14, 16, 18, 20, 22};
    /// Of the error estimate in H: that of order 14, without the sequence of the longest substeps.
    static constexpr int error_order = 15;

    /// The weights of the sequences from `first` on that extrapolate to h = 0.
    static constexpr std::array<double, sequences> weights(std::size_t first) {
        std::array<double, sequences> w{};
        for (std::size_t j = first; j < sequences; ++j) {
            w[j] = 1.0;
            for (std::size_t i = first; i < sequences; ++i) {
                const auto a = static_cast<double>(counts[j] * counts[j]),
                           b = static_cast<double>(counts[i] * counts[i]);
                if (i != j) w[j] *= a / (a - b);
            }
        }
        return w;
    }
};

/// One solution of a smooth model with N directions of derivative by Extrapolation. The sequences stand in the lanes of
/// packs: a step takes as long as 22 evaluations, and is three to five times as long as one of flow_method.
template <FlowPackModel M, std::size_t N, class Arch = xsimd::default_arch>
class ExtrapolatedFlow {
public:
    using Field = FlowField<M, N, Arch>;
    using P = typename Field::P;
    using Numbers = typename Field::Numbers;
    static constexpr std::size_t n = Field::n, size = Field::size;
    /// Values and partials, see FlowFieldBase::index.
    using Point = std::array<double, size>;

    /// @param p  with partials in the N directions
    ExtrapolatedFlow(const Values<Dual<N>, parameter_count_of<M>>& p, const FlowStart& start, const M& model)
        : field_(p, start.clock, model), options_(start.options), phase_(start.phase), x_{} {
        for (std::size_t c = 0; c < n; ++c) {
            x_[Field::index(c, 0)] = start.state[c];
            x_[Field::index(c, 1 + c)] = 1.0;
        }
        length_ = first_length(start);
    }

    /// Moves on to s = target.
    /// @return false where it does not get there: the steps are used up, become too short, or the rounding of the
    ///         extrapolation hides their errors. A Trajectory tells more.
    [[nodiscard]] bool advance(double target) {
        // In a row: then not the length is at fault.
        constexpr int most_rejected = 8;
        int rejected = 0;
        while (s_ < target) {
            stop_if_asked(options_.interrupted);
            const double remaining = target - s_;
            // Two equal steps instead of a full one and a tiny rest; a rest of 1e-6 is included in the step.
            const double ds = length_ >= remaining * (1.0 - 1e-6) ? remaining : std::min(length_, 0.5 * remaining);
            if (++steps_ > options_.maximum_steps || !(s_ + ds > s_)) return false;
            Point end, error;
            step(ds, end, error);
            const double ratio = error_ratio(end, error);
            constexpr double exponent = -1.0 / Extrapolation::error_order;
            const double factor = ratio > 0.0 ? std::clamp(0.8 * std::pow(ratio, exponent), 0.2, 5.0) : 5.0;
            if (!(ratio <= 1.0)) {
                if (++rejected > most_rejected) return false;
                length_ = ds * std::min(factor, 0.9);
                continue;
            }
            rejected = 0;
            x_ = end;
            s_ = ds == remaining ? target : s_ + ds;
            // A step shortened to end at the target must not shorten the next one.
            length_ = ds < length_ ? std::max(length_, ds * factor) : ds * factor;
        }
        return true;
    }

    [[nodiscard]] State<Dual<N>, n> state() const { return duals<N>(x_); }
    [[nodiscard]] double s() const { return s_; }
    [[nodiscard]] std::size_t steps() const { return steps_; }

private:
    static constexpr std::size_t packs = (Extrapolation::sequences + P::width - 1) / P::width;
    /// Of the lanes; those beyond the sequences repeat the last.
    static constexpr std::array<double, packs* P::width> lane_counts = [] {
        std::array<double, packs * P::width> counts{};
        for (std::size_t l = 0; l < counts.size(); ++l)
            counts[l] = static_cast<double>(Extrapolation::counts[std::min(l, Extrapolation::sequences - 1)]);
        return counts;
    }();

    /// A step of ds from x_, and its estimated error.
    [[gnu::noinline]] void step(double ds, Point& end, Point& error) const {
        static constexpr auto weights = Extrapolation::weights(0), coarser = Extrapolation::weights(1);
        Point change{};
        error.fill(0.0);
        for (std::size_t first = 0; first < Extrapolation::sequences; first += P::width) {
            const std::size_t last = std::min(first + P::width, Extrapolation::sequences) - 1;
            std::size_t j = first;
            substeps(ds / P::load(&lane_counts[first]), Extrapolation::counts[last],
                     [&](std::size_t m, const Numbers& z) {
                         if (m != Extrapolation::counts[j]) return;
                         double lanes[size * P::width];
                         for (std::size_t k = 0; k < size; ++k)
                             z[k].store(lanes + k * P::width);
                         for (std::size_t k = 0; k < size; ++k) {
                             const double moved = lanes[k * P::width + j - first] - x_[k];
                             change[k] += weights[j] * moved;
                             error[k] += (weights[j] - coarser[j]) * moved;
                         }
                         ++j;
                     });
        }
        for (std::size_t k = 0; k < size; ++k)
            end[k] = x_[k] + change[k];
    }

    /// The midpoint rule with substeps of h; at(m, z_m) is called for m > 1.
    template <class At>
    [[gnu::always_inline]] void substeps(const P& h, std::size_t count, const At& at) const {
        const P phase(phase_), side(1.0), time = h * field_.seconds(), twice = 2.0 * time;
        Numbers z[2], f;
        for (std::size_t k = 0; k < size; ++k)
            z[0][k] = P(x_[k]);
        field_.slope(field_.forcing_at(phase, P(s_)), z[0], side, time, f);
        for (std::size_t k = 0; k < size; ++k)
            z[1][k] = z[0][k] + f[k];
        for (std::size_t m = 1; m < count; ++m) {
            Numbers& next = z[(m + 1) % 2];
            field_.slope(field_.forcing_at(phase, fma(static_cast<double>(m), h, P(s_))), z[m % 2], side, twice, f);
            for (std::size_t k = 0; k < size; ++k)
                next[k] = next[k] + f[k];
            at(m + 1, next);
        }
    }

    /// As orbid::models::error_ratio.
    [[nodiscard]] double error_ratio(const Point& end, const Point& error) const {
        const auto to = duals<n>(end);
        for (const auto& coordinate : to)
            if (!std::isfinite(coordinate.value)) return std::numeric_limits<double>::infinity();
        return models::error_ratio<M, n>(duals<n>(error), duals<n>(x_), to, options_, field_.model());
    }

    /// With the first `count` partials.
    template <std::size_t count>
    static State<Dual<count>, n> duals(const Point& x) {
        State<Dual<count>, n> state;
        for (std::size_t c = 0; c < n; ++c) {
            state[c].value = x[Field::index(c, 0)];
            for (std::size_t j = 0; j < count; ++j)
                state[c].partial[j] = x[Field::index(c, 1 + j)];
        }
        return state;
    }

    /// At a tolerance of 1e-11 an eighth of the forcing's period, or four fifths of the time in which the state
    /// would change by its own size. The first error estimate corrects it.
    [[nodiscard]] double first_length([[maybe_unused]] const FlowStart& start) const {
        const double looser = std::pow(options_.relative_tolerance / 1e-11, 1.0 / Extrapolation::error_order);
        if constexpr (ForcedModel<M>) {
            const double turn = 2.0 * std::numbers::pi;
            return 0.125 * looser * (start.clock == Clock::phase ? turn : turn / start.theta[M::forcing_frequency]);
        } else {
            Numbers at, f;
            for (std::size_t k = 0; k < size; ++k)
                at[k] = P(x_[k]);
            field_.slope(field_.forcing_at(P(phase_), P(0.0)), at, P(1.0), P(1.0), f);
            double rate = 0.0;
            for (std::size_t c = 0; c < n; ++c)
                rate = std::max(rate,
                                std::abs(f[Field::index(c, 0)].lanes()[0]) / (std::abs(x_[Field::index(c, 0)]) + 1e-3));
            return std::isfinite(rate) && rate > 0.0 ? 0.8 * looser / rate : 0.01;
        }
    }

    Field field_;
    const FlowOptions& options_;
    double phase_;
    Point x_;
    double s_ = 0.0;
    double length_ = 0.0;
    std::size_t steps_ = 0;
};

/// Models whose single flows are extrapolated: smooth, of two coordinates. With three, the numbers of a substep take
/// longer than the stages of flow_method, unless these wait for sines (Lorenz: 1.5 times the time).
template <class M>
concept ExtrapolatedModel = FlowPackModel<M> && !SwitchingModel<M> && dimension_of<M> == 2;

/// Looser tolerances are kept as fast by flow_method; the rounding of the extrapolation does not keep tighter ones.
[[nodiscard]] inline bool kept_by_extrapolation(const FlowOptions& options) {
    return options.relative_tolerance >= 3e-12 && options.relative_tolerance <= 1e-7;
}

/// flow_pass by ExtrapolatedFlow.
/// @return whether it got to the end; otherwise the output holds numbers without a meaning
template <FlowPackModel M, class Arch = xsimd::default_arch>
bool extrapolated_flow(const FlowStart& start, std::span<const double> durations, std::span<const std::ptrdiff_t> free,
                       const FlowOutput& output, FlowEnd& end, const M& model) {
    constexpr std::size_t n = dimension_of<M>, q = parameter_count_of<M>, N = n + 4;
    const std::size_t directions = n + free.size();
    for (std::size_t first = 0; first == 0 || (output.sensitivities != nullptr && first < free.size());
         first += N - n) {
        State<Dual<N>, n> x{};
        auto p = array_from<Dual<N>, q>(start.theta);
        seed<N, n, q>(x, p, free, first);
        ExtrapolatedFlow<M, N, Arch> flow(p, start, model);
        for (std::size_t k = 0; k < durations.size(); ++k) {
            if (!flow.advance(durations[k])) return false;
            store_solution<N, n, 1>(flow.state(), k, first, 0, directions, output);
        }
        for (std::size_t c = 0; c < n; ++c)
            output.stopped_state[c] = flow.state()[c].value;
        end = {FlowStatus::ok, flow.s(), flow.steps(), 0, 0};
    }
    return true;
}

}  // namespace orbid::models

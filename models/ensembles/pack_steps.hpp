#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <optional>
#include <type_traits>
#include <vector>

#include "models/arithmetic/cubic_zero.hpp"
#include "models/arithmetic/pack.hpp"
#include "models/definition/model.hpp"
#include "models/definition/simulation.hpp"
#include "models/ensembles/step_coefficients.hpp"

namespace orbid::models {

/// The phase enters f only through one number, forcing(phase, constants), as in (M1) and (M2): it can be tabulated.
template <class M, class T = double>
concept TabulatedModel = ForcedModel<M> && requires(const M& model, const T& phase, const State<T, dimension_of<M>>& x,
                                                    const Constants<M, T>& c, const T& side) {
    { model.forcing(phase, c) } -> std::same_as<T>;
    { model.rhs_forced(phase, x, c, side) } -> std::same_as<State<T, dimension_of<M>>>;
};

namespace detail {
template <class M, class T>
concept PackRhs = (SwitchingModel<M> && RhsTaking<M, T, T>) || (!SwitchingModel<M> && RhsTaking<M, T>);
}  // namespace detail

/// Trajectories can be computed in packs: rhs, or forcing and rhs_forced, take a Pack as scalar, and as side where
/// there is one. A model whose equations branch on their scalar says `packs = false`.
template <class M>
concept PackModel = ForcedModel<M> && !SurfaceTable<M> && !StiffModel<M> &&
                    (detail::PackRhs<M, Pack<1>> || TabulatedModel<M, Pack<1>>)&&!requires {
    requires !M::packs;
};

/// One period divided into equal steps, with the forcing at all nodes of all steps: the same for all trajectories.
struct PeriodSteps {
    std::size_t count;
    double length;  ///< of a step [rad]
    double time;    ///< of a step [s]
    StepCoefficients<verner98> coefficients;
    std::vector<std::array<double, verner98.stages>> forcing;

    [[nodiscard]] double start(std::size_t k) const { return static_cast<double>(k) * length; }
    /// The very end of the period for the last step.
    [[nodiscard]] double end(std::size_t k) const { return k + 1 == count ? 2.0 * std::numbers::pi : start(k + 1); }
};

/// A step of the trajectories in a pack, with its diagnostics.
template <class P, std::size_t n>
struct PackStep {
    State<P, n> end;
    typename P::Mask kept;  ///< estimated error allowed, end finite
    /// The velocity keeps its sign at the ends and, judged by the tangents, in between (switching models).
    typename P::Mask same_side;
    P first_rise, last_rise;  ///< acceleration times duration at the start and close to the end (switching models)
};

/// Steps of a model in packs: from the table of a period, or each lane with a start and a length of its own.
///
/// The side of the switching surface is frozen during a step. Every lane goes through the same operations, with fused
/// multiplications and additions where the machine has them.
template <PackModel M, class Arch = xsimd::default_arch>
class PackSteps {
public:
    static constexpr std::size_t n = dimension_of<M>;
    static constexpr std::size_t q = parameter_count_of<M>;
    /// As many registers in turn as hide the latency of an operation, as long as the sums of a stage stay in registers.
    /// Measured for n = 2, nanoseconds per stage and trajectory: 3.3 (one register), 1.9, 1.5, 1.4 (four).
    using Wide = Pack<(n <= 2 ? 4 : n <= 4 ? 2 : 1), Arch>;
    using Narrow = Pack<1, Arch>;

    PackSteps(const Values<double, q>& p, double phase, const FlowOptions& options, const M& model = M())
        : model_(model),
          wide_(constants_from<M, Wide>(spread<Wide>(p), model)),
          narrow_(constants_from<M, Narrow>(spread<Narrow>(p), model)),
          omega_(p[M::forcing_frequency]),
          phase_(phase),
          options_(options),
          unit_(1.0) {}

    [[nodiscard]] PeriodSteps period_in(std::size_t count) const {
        const double length = 2.0 * std::numbers::pi / static_cast<double>(count);
        PeriodSteps steps{count, length, length / omega_, StepCoefficients<verner98>(length / omega_), {}};
        steps.forcing.resize(count);
        std::vector<double> phases;
        for (std::size_t k = 0; k < count; ++k)
            for (const double node : verner98.nodes)
                phases.push_back(phase_ + (static_cast<double>(k) + node) * length);
        static_assert(verner98.stages % Narrow::width == 0);
        for (std::size_t k = 0; k < phases.size(); k += Narrow::width)
            forcing_at(Narrow::load(&phases[k]), narrow_)
                .store(&steps.forcing[k / verner98.stages][k % verner98.stages]);
        return steps;
    }

    [[nodiscard]] const M& model() const { return model_; }

    /// The step k of the period. Flattened: the model's functions too have to be inlined, as the operations of packs
    /// are.
    template <class P>
    [[nodiscard, gnu::flatten]] PackStep<P, n> tabulated(const PeriodSteps& steps, std::size_t k,
                                                         const State<P, n>& x) const {
        const Constants<M, P>& constants = constants_of<P>();
        const P side = side_of(x);
        const double* forcing = steps.forcing[k].data();
        State<P, n> slopes[verner98.stages], error;
        PackStep<P, n> step;
        explicit_step<verner98, P, n>(
            steps.coefficients, x,
            [&](std::size_t i, const State<P, n>& at) { return rate(P(forcing[i]), at, constants, side); }, slopes,
            step.end, error);
        judge(x, error, side, P(steps.time), slopes, step);
        return step;
    }

    /// Each lane a step of its own ds [rad] from s on its own side.
    template <class P>
    [[nodiscard, gnu::flatten]] PackStep<P, n> free(const State<P, n>& x, const P& s, const P& ds,
                                                    const P& side) const {
        const P time = ds / omega_;
        State<P, n> slopes[verner98.stages], error;
        PackStep<P, n> step;
        explicit_step<verner98, P, n>(
            unit_, x,
            [&](std::size_t i, const State<P, n>& at) {
                State<P, n> f = slope(at, s + verner98.nodes[i] * ds, side);
                for (P& component : f)
                    component = component * time;
                return f;
            },
            slopes, step.end, error);
        judge(x, error, side, P(1.0), slopes, step);
        return step;
    }

    /// dx/dt at s.
    template <class P>
    [[nodiscard]] State<P, n> slope(const State<P, n>& x, const P& s, const P& side) const {
        const Constants<M, P>& constants = constants_of<P>();
        return rate(forcing_at(phase_ + s, constants), x, constants, side);
    }

    /// Lanes that went through the switching surface to `until`; where not `good`, the state is meaningless.
    struct Passage {
        State<Narrow, n> end;
        typename Narrow::Mask good;
    };
    /// To the surface by a step of which the velocity changes its sign, and on from there on the other side.
    /// @param s, length       start and length of that step [rad]
    /// @param v1, moved       velocity at its end, way of the position
    /// @param first, last     accelerations times duration at its ends
    [[nodiscard]] Passage through_surface(const State<Narrow, n>& x, const Narrow& s, const Narrow& length,
                                          const Narrow& side, const Narrow& v1, const Narrow& moved,
                                          const Narrow& first, const Narrow& last,
                                          double until) const requires SwitchingModel<M> {
        const Narrow integral = moved * omega_ / length;
        const Narrow guess = quartic_zero(x[velocity], v1, first, last, integral);
        const auto to = free(x, s, guess * length, side);
        // From there to the zero of the velocity by the midpoint rule, with the step that makes it zero. The distance
        // is the error of the guess. Its cube is below all tolerances as long as it is less than 1e-4 of the step.
        const Narrow near = s + guess * length;
        const State<Narrow, n> f = slope(to.end, near, side);
        const Narrow about = -to.end[velocity] / f[velocity];
        State<Narrow, n> between;
        for (std::size_t c = 0; c < n; ++c)
            between[c] = to.end[c] + 0.5 * about * f[c];
        const State<Narrow, n> g = slope(between, near + 0.5 * omega_ * about, side);
        const Narrow correction = -to.end[velocity] / g[velocity];
        State<Narrow, n> surface{to.end[0] + correction * g[0], Narrow(0.0)};
        const Narrow at = min(near + omega_ * correction, Narrow(until));
        auto good = to.kept & (abs(correction) * omega_ <= 1e-4 * length);
        // Crossed, neither held nor grazing. The accelerations of both sides point across, and clearly so where they
        // differ (1e-6 of the jump; a Trajectory decides closer cases).
        const Narrow arriving = side * slope(surface, at, side)[velocity];
        const Narrow leaving = side * slope(surface, at, -side)[velocity];
        const Narrow margin = 1e-6 * abs(leaving - arriving);
        good = good & (arriving < -margin) & (leaving < -margin);
        const auto on = free(surface, at, Narrow(until) - at, -side);
        return {on.end, good & on.kept & (side * on.end[velocity] < Narrow(0.0))};
    }

    /// +1 or -1; 1 for models without a switching surface.
    template <class P>
    [[nodiscard]] static P side_of([[maybe_unused]] const State<P, n>& x) {
        if constexpr (SwitchingModel<M>)
            return copysign(P(1.0), x[velocity]);
        else
            return P(1.0);
    }

private:
    template <class P>
    static Values<P, q> spread(const Values<double, q>& p) {
        Values<P, q> same;
        for (std::size_t i = 0; i < q; ++i)
            same[i] = P(p[i]);
        return same;
    }
    template <class P>
    const Constants<M, P>& constants_of() const {
        if constexpr (std::is_same_v<P, Wide>)
            return wide_;
        else
            return narrow_;
    }
    template <class P>
    P forcing_at(const P& phase, const Constants<M, P>& constants) const {
        if constexpr (TabulatedModel<M, P>)
            return model_.forcing(phase, constants);
        else
            return phase;
    }
    template <class P>
    State<P, n> rate(const P& forcing, const State<P, n>& x, const Constants<M, P>& constants,
                     [[maybe_unused]] const P& side) const {
        if constexpr (TabulatedModel<M, P>)
            return model_.rhs_forced(forcing, x, constants, side);
        else if constexpr (SwitchingModel<M>)
            return model_.rhs(forcing, x, constants, side);
        else
            return model_.rhs(forcing, x, constants);
    }

    /// The tolerances of error_ratio(), and what switching models look for.
    /// @param duration  makes slopes rises over the step
    template <class P>
    void judge(const State<P, n>& x, const State<P, n>& error, [[maybe_unused]] const P& side,
               [[maybe_unused]] const P& duration, [[maybe_unused]] const State<P, n> (&slopes)[verner98.stages],
               PackStep<P, n>& step) const {
        step.kept = P(0.0) == P(0.0);
        for (std::size_t i = 0; i < n; ++i) {
            P size = max(abs(x[i]), abs(step.end[i]));
            step.kept = step.kept & (size <= P(std::numeric_limits<double>::max()));
            if (model_.coordinates[i].angle) size = min(size, P(std::numbers::pi));
            step.kept =
                step.kept & (abs(error[i]) <= fma(options_.relative_tolerance, size, P(options_.absolute_tolerance)));
        }
        if constexpr (SwitchingModel<M>) {
            const P v0 = side * x[velocity], v1 = side * step.end[velocity];
            step.first_rise = duration * slopes[0][velocity];
            step.last_rise = duration * slopes[verner98.stages - 1][velocity];
            step.same_side = (v0 > P(0.0)) & (v1 > P(0.0));
            // Slower in between than at both ends: two crossings may hide in the step. The tangents bound the dip of a
            // convex curve. A dip is accepted only if it stays above half of the smaller end.
            const P fall = side * step.first_rise, rise = side * step.last_rise;
            const auto dips = (fall < P(0.0)) & (rise > P(0.0));
            if (dips.any()) {
                const P meet = min(max((v1 - v0 - rise) / (fall - rise), P(0.0)), P(1.0));
                step.same_side = step.same_side & ((!dips) | (v0 + fall * meet > 0.5 * min(v0, v1)));
            }
        }
    }

    [[no_unique_address]] M model_;
    Constants<M, Wide> wide_;
    Constants<M, Narrow> narrow_;
    double omega_;
    double phase_;
    FlowOptions options_;
    StepCoefficients<verner98> unit_;
};

/// The steps of a period by level: level has 2^(level/2) times as many as the coarsest table; two levels double them
/// exactly. Made when they are asked for.
template <class Steps>
class PeriodTables {
public:
    /// Refinement by 2^5 at most: beyond that, steps of free length are better.
    static constexpr std::size_t finest = 10;

    PeriodTables(const Steps& steps, const PeriodSteps& coarsest) : steps_(steps), coarsest_(coarsest) {}

    const PeriodSteps& operator[](std::size_t level) {
        if (level == 0) return coarsest_;
        std::optional<PeriodSteps>& period = finer_[level - 1];
        if (!period) {
            const auto odd =
                static_cast<std::size_t>(std::lround(std::numbers::sqrt2 * static_cast<double>(coarsest_.count)));
            period = steps_.period_in((level % 2 == 0 ? coarsest_.count : odd) << (level / 2));
        }
        return *period;
    }

private:
    const Steps& steps_;
    const PeriodSteps& coarsest_;
    std::array<std::optional<PeriodSteps>, finest + 2> finer_;  ///< halved steps are two levels up
};

}  // namespace orbid::models

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>

#include "models/ensembles/pack_block.hpp"
#include "models/trajectories/flow.hpp"

namespace orbid::models {

/// Sections of many trajectories of a forced model over whole periods.
template <ForcedModel M, class Arch = xsimd::default_arch>
class SectionEnsemble {
public:
    static constexpr std::size_t n = dimension_of<M>;
    static constexpr std::size_t q = parameter_count_of<M>;
    using Point = State<double, n>;

    SectionEnsemble(const Values<double, q>& p, double phase, const FlowOptions& options, const M& model = M())
        : model_(model), p_(p), phase_(phase), options_(options) {}

    /// As Kernel::ensemble().
    void advance(const double* starts, std::size_t count, std::size_t periods, double* const* sections,
                 std::size_t* columns, FlowStatus* status) const {
        for (std::size_t i = 0; i < count; ++i)
            status[i] = one(starts + i * n, periods, sections[i], columns[i]);
    }

    /// Preferred number of trajectories in one call of advance().
    static constexpr std::size_t block = 1;

private:
    FlowStatus one(const double* start, std::size_t periods, double* sections, std::size_t& columns) const {
        std::copy(start, start + n, sections);
        columns = 1;
        auto x = array_from<double, n>(start);
        // The step budget holds for one call of a flow; here that is one period.
        FlowOptions whole = options_;
        whole.maximum_steps = std::numeric_limits<std::size_t>::max();
        TrajectoryOf<M, 0> trajectory(p_, x, phase_, Clock::phase, whole, nullptr, model_);
        for (; columns <= periods; ++columns) {
            trajectory.limit_steps(trajectory.steps() + options_.maximum_steps);
            trajectory.restart(x);
            const FlowStatus status = trajectory.advance(2.0 * std::numbers::pi);
            if (status != FlowStatus::ok) return status;
            x = trajectory.state();
            for (std::size_t i = 0; i < n; ++i) {
                if (model_.coordinates[i].angle) x[i] = wrapped(x[i]);
                sections[columns * n + i] = x[i];
            }
        }
        return FlowStatus::ok;
    }

    [[no_unique_address]] M model_;
    Values<double, q> p_;
    double phase_;
    FlowOptions options_;
};

/// The same in packs.
template <PackModel M, class Arch>
class SectionEnsemble<M, Arch> {
public:
    static constexpr std::size_t n = dimension_of<M>;
    static constexpr std::size_t q = parameter_count_of<M>;

    SectionEnsemble(const Values<double, q>& p, double phase, const FlowOptions& options, const M& model = M())
        : SectionEnsemble(p, phase, options, steps_for(options), model) {}

    /// With a given number of steps per period.
    SectionEnsemble(const Values<double, q>& p, double phase, const FlowOptions& options, std::size_t steps,
                    const M& model = M())
        : p_(p), phase_(phase), options_(options), steps_(p, phase, options, model), period_(steps_.period_in(steps)) {}

    void advance(const double* starts, std::size_t count, std::size_t periods, double* const* sections,
                 std::size_t* columns, FlowStatus* status) const {
        PackBlock<M, Arch>(p_, phase_, options_, steps_, period_, starts, count, sections, columns, status)
            .advance(periods);
    }

    /// In each step some hundredths of the trajectories meet the switching surface; they should fill a pack. 256 states
    /// of two coordinates and the data of a step fit the first-level cache.
    static constexpr std::size_t block = 256;

private:
    /// Steps of the coarsest table. Order 9: they go with the ninth root of the tolerance.
    static std::size_t steps_for(const FlowOptions& options) {
        const double tolerance = std::max(options.relative_tolerance, options.absolute_tolerance);
        return static_cast<std::size_t>(std::clamp(steps_at_1e12 * std::pow(1e-12 / tolerance, 1.0 / 9.0), 8.0, 400.0));
    }
    // Measured at 1e-12 (block of 256; microseconds per period and trajectory over the number of steps). Parametric
    // pendulum: 24 2.1, 28 1.9, 32 1.5, 36 1.6, 48 2.0. Torque-driven pendulum: 32 2.3, 48 2.3, 64 1.9, 80 2.3; begun
    // with 32 it spends most of its time in the table of 64. Too many steps cost more than too few, which are refined.
    static constexpr double steps_at_1e12 = 32.0;

    Values<double, q> p_;
    double phase_;
    FlowOptions options_;
    PackSteps<M, Arch> steps_;
    PeriodSteps period_;
};

}  // namespace orbid::models

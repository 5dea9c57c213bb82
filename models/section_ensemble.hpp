#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>

#include "models/flow.hpp"
#include "models/period_grid.hpp"

namespace orbid::models {

/// Sections of many trajectories of a forced model over whole periods.
template <ForcedModel M>
class SectionEnsemble {
public:
    static constexpr std::size_t n = dimension_of<M>;
    static constexpr std::size_t q = parameter_count_of<M>;

    SectionEnsemble(const Values<double, q>& p, double phase, const FlowOptions& options)
        : p_(p), phase_(phase), options_(options), grid_(grid_for(p, phase, options)) {}

    /// As Kernel::ensemble().
    void advance(const double* starts, std::size_t count, std::size_t periods, double* const* sections,
                 std::size_t* columns, FlowStatus* status) const {
        for (std::size_t i = 0; i < count; ++i)
            status[i] = one(starts + i * n, periods, sections[i], columns[i]);
    }

private:
    struct NoGrid {};
    static auto grid_for([[maybe_unused]] const Values<double, q>& p, [[maybe_unused]] double phase,
                         [[maybe_unused]] const FlowOptions& options) {
        if constexpr (TabulatedModel<M>) {
            const double tolerance = std::max(options.relative_tolerance, options.absolute_tolerance);
            const double steps = std::clamp(steps_at_1e12 * std::pow(1e-12 / tolerance, 0.125), 8.0, 400.0);
            return PeriodGrid<M>(p, phase, static_cast<std::size_t>(steps), options);
        } else {
            return NoGrid{};
        }
    }
    // Measured (k1 = 0, four trajectories, bench/ensemble_bench): 64 steps take 1.26 times the time and leave a tenth
    // of the error (median 1.7e-13 a period instead of 1.7e-12); 40 take 1.23 times the time, as steps begin to fail.
    // Of the time a fifth goes to velocity zeros, and half to the sines of the table's stages, each waiting for the one
    // before.
    static constexpr double steps_at_1e12 = 48.0;

    FlowStatus one(const double* start, std::size_t periods, double* sections, std::size_t& columns) const {
        std::copy(start, start + n, sections);
        columns = 1;
        auto x = array_from<double, n>(start);
        // The step budget holds for one call of a flow; here that is one period.
        FlowOptions whole = options_;
        whole.maximum_steps = std::numeric_limits<std::size_t>::max();
        Trajectory<M, 0> trajectory(p_, x, phase_, Clock::phase, whole);
        for (; columns <= periods; ++columns) {
            trajectory.limit_steps(trajectory.steps() + options_.maximum_steps);
            FlowStatus status;
            if constexpr (TabulatedModel<M>) {
                status = grid_.advance(x, trajectory);
            } else {
                trajectory.restart(x);
                status = trajectory.advance(2.0 * std::numbers::pi);
                x = trajectory.state();
            }
            if (status != FlowStatus::ok) return status;
            for (std::size_t i = 0; i < n; ++i) {
                if (M::coordinates[i].angle) x[i] = wrapped(x[i]);
                sections[columns * n + i] = x[i];
            }
        }
        return FlowStatus::ok;
    }

    Values<double, q> p_;
    double phase_;
    FlowOptions options_;
    decltype(grid_for(std::declval<const Values<double, q>&>(), 0.0, std::declval<const FlowOptions&>())) grid_;
};

}  // namespace orbid::models

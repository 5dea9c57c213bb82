#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>
#include <vector>

#include "models/trajectory.hpp"

namespace orbid::models {

/// The phase enters f only through one number, forcing(phase, constants), as in (M1) and (M2): it can be tabulated.
template <class M>
concept TabulatedModel = ForcedModel<M> &&
    requires(const double& phase, const State<double, dimension_of<M>>& x, const Constants<M, double>& c, double side) {
    { M::forcing(phase, c) } -> std::same_as<double>;
    { M::rhs_forced(phase, x, c, side) } -> std::same_as<State<double, dimension_of<M>>>;
};

namespace detail {

// Fehlberg's 7(8) method, the one of Stepper, from NASA TR R-287 as Boost.Odeint has it; here known at compile time so
// that its many zeros cost nothing.
inline constexpr std::size_t stages = 13;
inline constexpr std::array<double, stages> fehlberg_nodes{0.0,     2.0 / 27, 1.0 / 9, 1.0 / 6, 5.0 / 12, 0.5, 5.0 / 6,
                                                           1.0 / 6, 2.0 / 3,  1.0 / 3, 1.0,     0.0,      1.0};
inline constexpr double fehlberg[stages][stages - 1] = {
    {},
    {2.0 / 27},
    {1.0 / 36, 1.0 / 12},
    {1.0 / 24, 0, 1.0 / 8},
    {5.0 / 12, 0, -25.0 / 16, 25.0 / 16},
    {1.0 / 20, 0, 0, 1.0 / 4, 1.0 / 5},
    {-25.0 / 108, 0, 0, 125.0 / 108, -65.0 / 27, 125.0 / 54},
    {31.0 / 300, 0, 0, 0, 61.0 / 225, -2.0 / 9, 13.0 / 900},
    {2.0, 0, 0, -53.0 / 6, 704.0 / 45, -107.0 / 9, 67.0 / 90, 3.0},
    {-91.0 / 108, 0, 0, 23.0 / 108, -976.0 / 135, 311.0 / 54, -19.0 / 60, 17.0 / 6, -1.0 / 12},
    {2383.0 / 4100, 0, 0, -341.0 / 164, 4496.0 / 1025, -301.0 / 82, 2133.0 / 4100, 45.0 / 82, 45.0 / 164, 18.0 / 41},
    {3.0 / 205, 0, 0, 0, 0, -6.0 / 41, -3.0 / 205, -3.0 / 41, 3.0 / 41, 6.0 / 41},
    {-1777.0 / 4100, 0, 0, -341.0 / 164, 4496.0 / 1025, -289.0 / 82, 2193.0 / 4100, 51.0 / 82, 33.0 / 164, 12.0 / 41, 0,
     1.0}};
inline constexpr std::array<double, stages> fehlberg_weights{
    0, 0, 0, 0, 0, 34.0 / 105, 9.0 / 35, 9.0 / 35, 9.0 / 280, 9.0 / 280, 0, 41.0 / 840, 41.0 / 840};
inline constexpr double fehlberg_error = 41.0 / 840;

}  // namespace detail

/// One period cut into equal steps on which the forcing is tabulated once, for all periods and trajectories.
///
/// A step that keeps its tolerance and does not meet the switching surface is taken from the table; every other one is
/// handed to a Trajectory, which locates crossings, sticks, and refines. So the error control is that of a flow.
template <TabulatedModel M>
class PeriodGrid {
public:
    static constexpr std::size_t n = dimension_of<M>;
    using Point = State<double, n>;

    PeriodGrid(const Values<double, parameter_count_of<M>>& p, double phase, std::size_t steps,
               const FlowOptions& options)
        : constants_(constants_from<M, double>(p)),
          inverse_omega_(1.0 / p[M::forcing_frequency]),
          step_(2.0 * std::numbers::pi / static_cast<double>(steps)),
          options_(options),
          forcing_(steps) {
        for (std::size_t k = 0; k < steps; ++k)
            for (std::size_t i = 0; i < detail::stages; ++i)
                forcing_[k][i] =
                    M::forcing(phase + (static_cast<double>(k) + detail::fehlberg_nodes[i]) * step_, constants_);
    }

    /// Moves x over one period. `general` serves the steps that the table cannot take; it belongs to the same
    /// parameters, phase and options, and counts them in its steps().
    [[nodiscard]] FlowStatus advance(Point& x, Trajectory<M, 0>& general) const {
        const std::size_t before = general.steps();
        for (std::size_t k = 0; k < forcing_.size(); ++k) {
            // Steps of the table count like all others.
            if (k + (general.steps() - before) >= options_.maximum_steps) return FlowStatus::step_budget;
            if (tabulated_step(k, x)) continue;
            const bool last = k + 1 == forcing_.size();
            general.restart(x, static_cast<double>(k) * step_);
            const FlowStatus status =
                general.advance(last ? 2.0 * std::numbers::pi : static_cast<double>(k + 1) * step_);
            x = general.state();
            if (status != FlowStatus::ok) return status;
        }
        return FlowStatus::ok;
    }

private:
    bool tabulated_step(std::size_t k, Point& x) const {
        double side = 1.0;
        if constexpr (SwitchingModel<M>) {
            if (x[velocity] == 0.0) return false;
            side = x[velocity] < 0.0 ? -1.0 : 1.0;
        }
        std::array<Point, detail::stages> slope;  // times the length of the step
        evaluate_stages(k, x, side, slope, std::make_index_sequence<detail::stages>{});
        Point end = x, error;
        add<detail::stages>(end, detail::fehlberg_weights, slope, std::make_index_sequence<detail::stages>{});
        for (std::size_t c = 0; c < n; ++c) {
            error[c] = detail::fehlberg_error * (slope[0][c] + slope[10][c] - slope[11][c] - slope[12][c]);
            if (!std::isfinite(end[c])) return false;
        }
        if (!(error_ratio<M, 0>(error, x, end, options_) <= 1.0)) return false;
        if constexpr (SwitchingModel<M>) {
            if (!(side * end[velocity] > 0.0)) return false;
            // Slower in between than at both ends: crossings may hide in the step when the tangents, which bound the
            // dip, come below half of the smaller end.
            const double v0 = side * x[velocity], v1 = side * end[velocity];
            const double fall = side * slope[0][velocity], rise = side * slope[12][velocity];
            if (fall < 0.0 && rise > 0.0) {
                const double meet = std::clamp((v1 - v0 - rise) / (fall - rise), 0.0, 1.0);
                if (!(v0 + fall * meet > 0.5 * std::min(v0, v1))) return false;
            }
        }
        x = end;
        return true;
    }

    template <std::size_t... i>
    void evaluate_stages(std::size_t k, const Point& x, double side, std::array<Point, detail::stages>& slope,
                         std::index_sequence<i...>) const {
        (evaluate_stage<i>(k, x, side, slope), ...);
    }
    template <std::size_t i>
    void evaluate_stage(std::size_t k, const Point& x, double side, std::array<Point, detail::stages>& slope) const {
        Point at = x;
        add_row<i>(at, slope, std::make_index_sequence<i>{});
        slope[i] = rhs(forcing_[k][i], at, side);
        for (double& component : slope[i])
            component *= step_ * inverse_omega_;
    }
    Point rhs(double forcing, const Point& x, double side) const { return M::rhs_forced(forcing, x, constants_, side); }
    template <std::size_t i, std::size_t... j>
    static void add_row(Point& at, const std::array<Point, detail::stages>& slope, std::index_sequence<j...>) {
        (add_term<detail::fehlberg[i][j] != 0.0>(at, detail::fehlberg[i][j], slope[j]), ...);
    }
    template <std::size_t count, std::size_t... j>
    static void add(Point& at, const std::array<double, count>& weights, const std::array<Point, detail::stages>& slope,
                    std::index_sequence<j...>) {
        (add_term<detail::fehlberg_weights[j] != 0.0>(at, weights[j], slope[j]), ...);
    }
    template <bool present>
    static void add_term(Point& at, double weight, const Point& slope) {
        if constexpr (present)
            for (std::size_t c = 0; c < n; ++c)
                at[c] += weight * slope[c];
    }

    Constants<M, double> constants_;
    double inverse_omega_;
    double step_;
    FlowOptions options_;
    std::vector<std::array<double, detail::stages>> forcing_;
};

}  // namespace orbid::models

#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "models/arithmetic/matrix_layout.hpp"
#include "models/definition/input_signal.hpp"
#include "models/definition/parameter.hpp"
#include "models/definition/sensor.hpp"
#include "models/definition/simulation.hpp"

#pragma GCC visibility push(default)

namespace orbid::models {

/// x -> S x, S = diag(signs), maps solutions at phase tau to solutions at phase tau + phase_shift.
struct Symmetry {
    std::vector<double> signs;  ///< +1 or -1 per coordinate
    double phase_shift = 0.0;   ///< [rad]; 0 when the symmetry acts within one section
};

/// States of one trajectory at the requested instants, with derivatives when asked for.
struct FlowResult {
    FlowStatus status = FlowStatus::ok;
    double stopped_after = 0.0;     ///< duration reached, in the units of the clock (the last instant when ok)
    Eigen::VectorXd stopped_state;  ///< shape (n): the state there
    Eigen::MatrixXd states;         ///< shape (n, m): column k = state after duration k; angles are NOT wrapped
    /// Shape (n, m * d): columns [k d, (k + 1) d) = d state_k / d(x0, free parameters). d = n + number of free
    /// parameters, or 0 when no sensitivities were asked for. Exact derivatives of the computed states.
    Eigen::MatrixXd sensitivities;
    std::size_t steps = 0;      ///< integrator steps, accepted and rejected
    std::size_t crossings = 0;  ///< switching events located
    std::size_t stickings = 0;  ///< intervals of sticking entered

    [[nodiscard]] auto sensitivity(Eigen::Index k, Eigen::Index directions) const {
        return sensitivities.middleCols(k * directions, directions);
    }
};

/// A flow with second derivatives: what FlowResult holds, and
/// `second_derivatives`, shape (n, m * d * d): column (k d + i) d + j = d2 state_k / d direction i d direction j.
struct SecondOrderResult : FlowResult {
    Eigen::MatrixXd second_derivatives;
};

/// A hyperplane in the state space of an autonomous flow: normal . x = offset, crossed in one direction.
struct Section {
    Eigen::VectorXd normal;  ///< shape (n), not 0
    double offset = 0.0;
    int direction = 1;  ///< +1: crossings with normal . x' > 0, -1: with normal . x' < 0
};

/// Successive crossings of a section, with derivatives when asked for (d = 0 columns otherwise).
struct CrossingResult {
    FlowStatus status = FlowStatus::ok;
    Eigen::VectorXd times;               ///< shape (m): time of each crossing since the start [s]
    Eigen::MatrixXd states;              ///< shape (n, m); fewer columns when not all were reached
    Eigen::MatrixXd sensitivities;       ///< shape (n, m * d): of the crossing point, which moves along the plane
    Eigen::MatrixXd time_sensitivities;  ///< shape (d, m): of `times`
    double stopped_after = 0.0;
    Eigen::VectorXd stopped_state;
    std::size_t steps = 0;
};

/// What the sensor reads at given states. Shapes (n, m) and (n, m * d) as in FlowResult;
/// derivatives with respect to the state AT THAT INSTANT and the free parameters.
struct ReadingResult {
    FlowStatus status = FlowStatus::ok;
    Eigen::MatrixXd readings;
    Eigen::MatrixXd derivatives;
};

/// Sections of many trajectories. sections[i] has shape (n, periods + 1), column 0 = the start; fewer columns when the
/// trajectory could not be continued (status[i] says why).
struct EnsembleResult {
    std::vector<Eigen::MatrixXd> sections;
    std::vector<Eigen::VectorXd> times;  ///< autonomous flows: times[i] of the columns of sections[i] [s]; else empty
    std::vector<FlowStatus> status;
};

/// A model behind plain types: const, thread-safe, holds no parameter values. Everything above `models/` is compiled
/// against this. The functions with a body here are optional: a system that does not offer them throws
/// std::logic_error. theta always has the full length parameters().size(), in that order; values outside their domain
/// are a wrong call (std::invalid_argument).
///
/// Directions of sensitivities: the n coordinates of the start, then the parameters listed in `free` (indices into
/// parameters(), any order, no duplicates).
class System {
public:
    virtual ~System() = default;

    [[nodiscard]] virtual std::string_view name() const = 0;
    [[nodiscard]] virtual std::string_view variant() const = 0;  ///< empty when the model has none
    [[nodiscard]] virtual Kind kind() const = 0;
    [[nodiscard]] virtual std::span<const Coordinate> coordinates() const = 0;
    [[nodiscard]] virtual std::span<const Parameter> parameters() const = 0;
    [[nodiscard]] virtual std::optional<Symmetry> symmetry() const = 0;
    /// Slow and fast scales far apart: steps are taken by an implicit method.
    [[nodiscard]] virtual bool stiff() const { return false; }
    /// What an evaluation of the equations costs, in those of equations as short as Lorenz's: by the length of
    /// formulas, where the model has them, not by the clock. At least 1.
    [[nodiscard]] virtual double evaluation_cost() const { return 1.0; }
    /// Measured inputs u(t) that the equations read; empty for most models.
    [[nodiscard]] virtual std::span<const Coordinate> inputs() const { return {}; }
    /// The same model with this signal as its inputs. A system whose inputs were not given cannot be simulated
    /// (std::logic_error); its phase argument is the time [s] of the start on the clock of the signal.
    /// @throws std::invalid_argument unless the signal has as many inputs as the model
    [[nodiscard]] virtual std::shared_ptr<const System> with_input(std::shared_ptr<const InputSignal> signal) const;
    /// The same model, which asks `interrupted` once per step of all its flows and throws Stopped when it says so.
    [[nodiscard]] virtual std::shared_ptr<const System> with_stop(std::function<bool()> interrupted) const;
    /// The same model for states of about this size, in the coordinates' units: absolute tolerances count in it.
    /// @throws std::invalid_argument unless size is finite and > 0
    [[nodiscard]] virtual std::shared_ptr<const System> with_state_size(double size) const;
    [[nodiscard]] virtual double state_size() const { return 1.0; }
    /// Neither f nor the state jumps at these parameters: finite differences and collocation apply.
    [[nodiscard]] virtual bool smooth(const Eigen::VectorXd& theta) const = 0;
    /// Period of the forcing in the given clock: 2 pi rad, or 2 pi / omega s. Throws std::logic_error unless forced.
    [[nodiscard]] virtual double period(const Eigen::VectorXd& theta, Clock clock) const = 0;
    /// Index of the parameter omega whose phase omega t the forcing has; none unless forced.
    [[nodiscard]] virtual std::optional<Eigen::Index> forcing_frequency() const { return std::nullopt; }
    /// At rest forever in this state (sticking that the forcing cannot end, or an equilibrium): used to notice
    /// standstill.
    [[nodiscard]] virtual bool at_rest(const Eigen::VectorXd& state, const Eigen::VectorXd& theta) const = 0;

    /// x' = f(x, tau; theta) per second at columns of states; phases has one entry per column. Shape (n, m).
    [[nodiscard]] virtual Eigen::MatrixXd rhs(const Eigen::MatrixXd& states, std::span<const double> phases,
                                              const Eigen::VectorXd& theta) const = 0;
    /// Its exact derivatives at columns of states, shape (n, m d): columns [k d, (k + 1) d) = d f_k / d(x, free
    /// parameters) at a fixed phase. The state decides the side of each switching surface.
    [[nodiscard]] virtual Eigen::MatrixXd rhs_derivatives(const Eigen::MatrixXd& states, std::span<const double> phases,
                                                          const Eigen::VectorXd& theta,
                                                          std::span<const Eigen::Index> free) const;

    /// States after each duration, from x0 at the given phase (forced; ignored otherwise). Durations are >= 0 and
    /// ascend; duplicates are allowed.
    [[nodiscard]] virtual FlowResult flow(const Eigen::VectorXd& x0, double phase, std::span<const double> durations,
                                          const Eigen::VectorXd& theta, Clock clock,
                                          const FlowOptions& options = {}) const = 0;

    /// The same with exact sensitivities (M4), (M5): same steps, same state values as flow().
    [[nodiscard]] virtual FlowResult flow_with_sensitivities(const Eigen::VectorXd& x0, double phase,
                                                             std::span<const double> durations,
                                                             const Eigen::VectorXd& theta,
                                                             std::span<const Eigen::Index> free, Clock clock,
                                                             const FlowOptions& options = {}) const = 0;

    /// Many short flows at once, all over the same durations; with sensitivities when `free` is given. Column k starts
    /// from starts.col(k) at phases[k] (one per column, also for models that ignore it). Values agree with flow() and
    /// flow_with_sensitivities() to the tolerance. Parallel over columns, the same bytes with any number of threads.
    [[nodiscard]] virtual std::vector<FlowResult> flows(const Eigen::MatrixXd& starts, std::span<const double> phases,
                                                        std::span<const double> durations, const Eigen::VectorXd& theta,
                                                        std::optional<std::span<const Eigen::Index>> free, Clock clock,
                                                        const FlowOptions& options = {}) const;

    /// flow_with_sensitivities() with second derivatives as well, at d + 1 times its cost. It takes steps of its own,
    /// so the last digits of the values differ.
    [[nodiscard]] virtual SecondOrderResult flow_with_second_derivatives(
        const Eigen::VectorXd& x0, double phase, std::span<const double> durations, const Eigen::VectorXd& theta,
        std::span<const Eigen::Index> free, Clock clock, const FlowOptions& options = {}) const;

    /// The next `count` crossings of a section by an autonomous flow, located to the accuracy of the flow; derivatives
    /// of return map and return times when `free` is given. A start on the section is no crossing.
    /// @param longest  [s], > 0: if there is no crossing for this long, the status is no_crossing
    /// @throws std::logic_error unless the model is autonomous
    [[nodiscard]] virtual CrossingResult crossings(const Eigen::VectorXd& x0, const Section& section, std::size_t count,
                                                   double longest, const Eigen::VectorXd& theta,
                                                   std::optional<std::span<const Eigen::Index>> free = std::nullopt,
                                                   const FlowOptions& options = {}) const;

    /// What the sensor reads at the columns of states (each at its phase), with derivatives when `free` is given.
    [[nodiscard]] virtual ReadingResult readings(const Sensor& sensor, const Eigen::MatrixXd& states,
                                                 std::span<const double> phases, const Eigen::VectorXd& theta,
                                                 std::optional<std::span<const Eigen::Index>> free = std::nullopt,
                                                 const FlowOptions& options = {}) const = 0;

    /// Sections of many trajectories, one per column of `starts`, over whole periods (forced) or unit steps (map).
    /// Parallel over trajectories; the same bytes with any number of threads. Angles are wrapped after each period.
    [[nodiscard]] virtual EnsembleResult ensemble(const Eigen::MatrixXd& starts, double phase, std::size_t periods,
                                                  const Eigen::VectorXd& theta,
                                                  const FlowOptions& options = {}) const = 0;

    /// The same for an autonomous flow: `count` crossings of a section by each trajectory. Column 0 is the start, which
    /// need not lie on the section; times[i][0] = 0.
    [[nodiscard]] virtual EnsembleResult crossing_ensemble(const Eigen::MatrixXd& starts, const Section& section,
                                                           std::size_t count, double longest,
                                                           const Eigen::VectorXd& theta,
                                                           const FlowOptions& options = {}) const;

    [[nodiscard]] Eigen::Index dimension() const { return static_cast<Eigen::Index>(coordinates().size()); }
    /// Index of a parameter or coordinate by name; -1 when there is none.
    [[nodiscard]] Eigen::Index parameter_index(std::string_view name) const;
    [[nodiscard]] Eigen::Index coordinate_index(std::string_view name) const;
    /// Shape (q): the defaults of the parameter table.
    [[nodiscard]] Eigen::VectorXd default_parameters() const;

protected:
    System() = default;
    System(const System&) = default;
    System& operator=(const System&) = default;
};

/// Which entries of an estimator's parameter vector are which parameters of a system.
/// `base` holds the values of the parameters that are not estimated, shape (q).
struct ParameterBinding {
    Eigen::VectorXd base;
    std::vector<Eigen::Index> parameter;  ///< index into System::parameters(), one per estimated parameter used here
    std::vector<Eigen::Index> estimated;  ///< index into the estimator's vector, same length
    Eigen::Index estimated_count = 0;     ///< length of the estimator's vector

    /// Full parameter vector of the system, shape (q).
    [[nodiscard]] Eigen::VectorXd values(const Eigen::VectorXd& theta) const;
    /// Columns d/d(parameter) spread over the estimator's vector: shape (rows, parameter.size()) -> (rows,
    /// estimated_count).
    [[nodiscard]] Eigen::MatrixXd spread(const Eigen::MatrixXd& columns) const;
};

}  // namespace orbid::models

#pragma GCC visibility pop

#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "models/parameter.hpp"
#include "models/sensor.hpp"

namespace orbid::models {

enum class Kind { forced, autonomous, map };

/// The variable in which durations of a flow are measured.
///
/// phase  tau = omega t [rad] (forced models only): the section stays where it is when omega changes,
///        sensitivities to omega are complete.
/// time   t [s].
enum class Clock { phase, time };

/// How a flow ended. Everything but ok means "cannot be simulated here": states after `stopped_after` are undefined.
enum class FlowStatus { ok, step_budget, not_finite, grazing };

[[nodiscard]] std::string_view description(FlowStatus status);

struct FlowOptions {
    double relative_tolerance = 1e-12;    ///< local error per step relative to the state, > 0
    double absolute_tolerance = 1e-12;    ///< local error per step, in the coordinate's unit, > 0
    std::size_t maximum_steps = 1000000;  ///< accepted and rejected steps of one call, > 0
};

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
    /// Shape (n, m * d): columns [k d, (k + 1) d) = d state_k / d(x0, free parameters), d = n + number of free
    /// parameters, or d = 0 when no sensitivities were asked for. Exact derivatives of the computed states.
    Eigen::MatrixXd sensitivities;
    std::size_t steps = 0;      ///< integrator steps, accepted and rejected
    std::size_t crossings = 0;  ///< switching events located
    std::size_t stickings = 0;  ///< intervals of sticking entered

    [[nodiscard]] auto sensitivity(Eigen::Index k, Eigen::Index directions) const {
        return sensitivities.middleCols(k * directions, directions);
    }
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
    std::vector<FlowStatus> status;
};

/// A model behind plain types: const, thread-safe, holds no parameter values. Everything above `models/` is compiled
/// against this. theta always has the full length parameters().size(), in that order; values outside their domain are
/// a wrong call (std::invalid_argument).
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
    /// No jump in f or in the state at these parameters: finite differences and collocation apply.
    [[nodiscard]] virtual bool smooth(const Eigen::VectorXd& theta) const = 0;
    /// Period of the forcing in the given clock: 2 pi rad, or 2 pi / omega s. Throws std::logic_error unless forced.
    [[nodiscard]] virtual double period(const Eigen::VectorXd& theta, Clock clock) const = 0;
    /// At rest for ever in this state (sticking that the forcing cannot end, or an equilibrium): used to notice
    /// standstill.
    [[nodiscard]] virtual bool at_rest(const Eigen::VectorXd& state, const Eigen::VectorXd& theta) const = 0;

    /// x' = f(x, tau; theta) per second at columns of states; phases has one entry per column. Shape (n, m).
    [[nodiscard]] virtual Eigen::MatrixXd rhs(const Eigen::MatrixXd& states, std::span<const double> phases,
                                              const Eigen::VectorXd& theta) const = 0;

    /// States after each duration, from x0 at the given phase (forced; ignored otherwise). Durations ascend, >= 0,
    /// equal to 0 allowed; duplicates allowed.
    [[nodiscard]] virtual FlowResult flow(const Eigen::VectorXd& x0, double phase, std::span<const double> durations,
                                          const Eigen::VectorXd& theta, Clock clock,
                                          const FlowOptions& options = {}) const = 0;

    /// The same with exact sensitivities (M4), (M5): same steps, same state values as flow().
    [[nodiscard]] virtual FlowResult flow_with_sensitivities(const Eigen::VectorXd& x0, double phase,
                                                             std::span<const double> durations,
                                                             const Eigen::VectorXd& theta,
                                                             std::span<const Eigen::Index> free, Clock clock,
                                                             const FlowOptions& options = {}) const = 0;

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

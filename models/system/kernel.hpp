#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string_view>

#include "models/definition/input_signal.hpp"
#include "models/definition/parameter.hpp"
#include "models/definition/simulation.hpp"
#include "models/system/section_plane.hpp"

#pragma GCC visibility push(default)

namespace orbid::models {

/// Where a solution starts and what it depends on. Pointers are to arrays of the model's dimension and number of
/// parameters. All values have been checked.
struct FlowStart {
    const double* state;
    double phase;
    const double* theta;
    Clock clock;
    FlowOptions options;
    const InputSignal* input = nullptr;  ///< of a model with measured inputs; `phase` is then the time [s] at the start
};

/// Common start data of many flows.
struct FlowStarts {
    const double* states;  ///< n x count
    const double* phases;  ///< count
    std::size_t count;
    const double* theta;
    Clock clock;
    FlowOptions options;
};

/// How a flow ended, and its counts.
struct FlowEnd {
    FlowStatus status = FlowStatus::ok;
    double stopped_after = 0.0;
    std::size_t steps = 0;
    std::size_t crossings = 0;
    std::size_t stickings = 0;
};

/// Where results are stored: arrays in column-major order, n rows; nullptr where they are not asked for. Directions are
/// the n of the start and the d - n free parameters.
struct FlowOutput {
    double* states;              ///< n x m
    double* stopped_state;       ///< n
    double* sensitivities;       ///< n x (m d): column k d + j = d state_k / d direction j
    double* second_derivatives;  ///< n x (m d d): column (k d + i) d + j = d2 state_k / d direction i d direction j
    double* times = nullptr;     ///< m: durations at which a section was crossed (crossings only)
    double* time_sensitivities = nullptr;  ///< m d: their derivatives (crossings only)
};

/// Many flows over the same durations that share what they have in common. Const, thread-safe.
class FlowBatch {
public:
    virtual ~FlowBatch() = default;
    /// Flows from column `first` on, one output and end for each. The result of a flow does not depend on which others
    /// share the call.
    virtual void run(std::size_t first, std::size_t count, const FlowOutput* outputs, FlowEnd* ends) const = 0;

protected:
    FlowBatch() = default;
    FlowBatch(const FlowBatch&) = default;
    FlowBatch& operator=(const FlowBatch&) = default;
};

/// The compiled part of a model behind plain pointers: const, thread-safe, holds no parameter values.
///
/// No Eigen type occurs here or behind it. Their alignment changes with the vector instructions of a machine, and a
/// model is compiled for those of the machine it runs on. Nothing is checked here; KernelSystem does that.
class Kernel {
public:
    virtual ~Kernel() = default;

    [[nodiscard]] virtual std::string_view name() const = 0;
    [[nodiscard]] virtual std::string_view variant() const { return {}; }
    [[nodiscard]] virtual Kind kind() const = 0;
    [[nodiscard]] virtual bool stiff() const { return false; }
    [[nodiscard]] virtual double evaluation_cost() const { return 1.0; }  ///< see System::evaluation_cost()
    [[nodiscard]] virtual std::span<const Coordinate> coordinates() const = 0;
    [[nodiscard]] virtual std::span<const Parameter> parameters() const = 0;
    [[nodiscard]] virtual std::span<const Coordinate> inputs() const { return {}; }
    [[nodiscard]] virtual std::optional<std::size_t> forcing_frequency() const { return std::nullopt; }
    [[nodiscard]] virtual std::span<const double> symmetry_signs() const { return {}; }  ///< empty: none
    [[nodiscard]] virtual double symmetry_phase_shift() const { return 0.0; }
    [[nodiscard]] virtual bool smooth(const double* /*theta*/) const { return true; }
    [[nodiscard]] virtual bool at_rest(const double* state, const double* theta) const = 0;

    /// f(x, phase; theta), or the image of a map.
    virtual void rhs(double phase, const double* state, const double* theta, const double* input, double* f) const = 0;
    /// d f / d(x, free parameters) there, n x d.
    virtual void rhs_derivatives(double phase, const double* state, const double* theta, const double* input,
                                 std::span<const std::ptrdiff_t> free, double* derivatives) const = 0;

    /// d2 f / d(x, free parameters)2 there, n x (d d): column i d + j = d2 f / d direction i d direction j; and
    /// d f / d phase, n.
    virtual void rhs_second_derivatives(double phase, const double* state, const double* theta, const double* input,
                                        std::span<const std::ptrdiff_t> free, double* second,
                                        double* by_phase) const = 0;

    /// States after each of the m durations; value and derivatives from the same steps.
    [[nodiscard]] virtual FlowEnd flow(const FlowStart& start, std::span<const double> durations,
                                       std::span<const std::ptrdiff_t> free, const FlowOutput& output) const = 0;

    /// Many flows, as flow() to the tolerance; nullptr where they are better computed one by one. The starts and the
    /// arrays they point to must outlive the batch.
    [[nodiscard]] virtual std::unique_ptr<const FlowBatch> flow_batch(const FlowStarts& /*starts*/,
                                                                      std::span<const double> /*durations*/,
                                                                      std::span<const std::ptrdiff_t> /*free*/) const {
        return nullptr;
    }

    /// The first `count` crossings of a plane after the start (a start on the plane is none), each at most
    /// `longest` after the one before.
    [[nodiscard]] virtual FlowEnd crossings(const FlowStart& start, const SectionPlane& plane, std::size_t count,
                                            double longest, std::span<const std::ptrdiff_t> free,
                                            const FlowOutput& output) const = 0;

    /// What the instrument reads in a state, n values, and the n x d derivatives (nullptr: none): the state itself, if
    /// not overridden.
    virtual void instrument(const double* state, const double* /*theta*/, std::span<const std::ptrdiff_t> free,
                            double* reading, double* derivative) const {
        const std::size_t n = coordinates().size();
        std::copy(state, state + n, reading);
        if (derivative == nullptr) return;
        std::fill(derivative, derivative + n * (n + free.size()), 0.0);
        for (std::size_t i = 0; i < n; ++i)
            derivative[i * n + i] = 1.0;
    }

    /// Sections over whole periods (forced) or iterations (map) of `count` trajectories that start at the columns of
    /// `starts`. sections[i] has room for n x (periods + 1) values, column 0 the start; columns[i] of them are valid.
    /// The results of a trajectory do not depend on which others share the call. KernelSystem does not ask autonomous
    /// models: they have no sections by phase.
    virtual void ensemble(const double* /*starts*/, std::size_t /*count*/, double /*phase*/, std::size_t /*periods*/,
                          const double* /*theta*/, const FlowOptions& /*options*/, double* const* /*sections*/,
                          std::size_t* /*columns*/, FlowStatus* /*status*/) const {}
    /// Preferred number of trajectories in one call of ensemble().
    [[nodiscard]] virtual std::size_t ensemble_block() const { return 1; }

protected:
    Kernel() = default;
    Kernel(const Kernel&) = default;
    Kernel& operator=(const Kernel&) = default;
};

}  // namespace orbid::models

#pragma GCC visibility pop

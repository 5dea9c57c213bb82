#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/eigen_layout.hpp"
#include "estimator/interface/estimate_options.hpp"
#include "estimator/interface/prior.hpp"
#include "identification/problem/experiment.hpp"
#include "identification/problem/residual_choice.hpp"
#include "models/formulas/expression.hpp"
#include "models/system/system.hpp"
#include "orbits/cycle_residuals/cycle_target.hpp"
#include "orbits/cycles/cycle_search.hpp"

#pragma GCC visibility push(default)

namespace orbid::identification {

/// A parameter of the model that is estimated.
struct FreeModelParameter {
    Eigen::Index parameter;          ///< index into System::parameters()
    estimator::FreeParameter value;  ///< start, scale, bounds, prior, tie; an empty name: that of the model
};

/// The bounds of a parameter's domain, on the scale that it has.
void set_default_bounds(const models::Parameter& entry, estimator::FreeParameter& free);

/// A parameter from this start, with scale and bounds of its domain: logarithmic where it must be positive.
[[nodiscard]] estimator::FreeParameter free_parameter(const models::Parameter& entry, double start);

/// The parameter `name` of a model, likewise.
/// @throws std::invalid_argument for an unknown name.
[[nodiscard]] FreeModelParameter free_parameter(const models::System& system, const std::string& name, double start);

/// A quantity of interest that is computed from parameters.
struct ModelQuantity {
    std::string name;
    models::Expression expression;  ///< in System::parameters(), in that order
};

/// Cycles that were measured, and where more of them may be found.
struct MeasuredCycles {
    /// Fills in `search`, `section` and `options` when a stage needs them for the first time, which may be never;
    /// empty: they are there.
    std::function<void(MeasuredCycles& measured)> find{};
    orbits::CycleSearch search;                     ///< as orbits::find_cycles() returns it; one list of cycles will do
    std::optional<std::size_t> experiment;          ///< whose record was searched; nothing: the points are states
    double section_phase = 0.0;                     ///< [rad] of the section, forced models
    std::optional<models::Section> plane{};         ///< of the section, autonomous flows: along one coordinate
    std::shared_ptr<const orbits::Series> section;  ///< what was searched; null: no more are searched for
    orbits::CycleSearchOptions options;             ///< of that search

    [[nodiscard]] orbits::SectionPlace place() const {
        return plane ? orbits::SectionPlace(*plane) : orbits::SectionPlace(section_phase);
    }
    /// Whether points and times of these cycles share errors that are not known: those of autonomous flows do.
    [[nodiscard]] bool shares_unknown_errors(const std::vector<orbits::Cycle>& cycles) const {
        return plane && std::none_of(cycles.begin(), cycles.end(),
                                     [](const orbits::Cycle& cycle) { return cycle.common.size() > 0; });
    }
};

/// What is to be identified from what. At least one of `cycles`, `series`, `waveform` and `branch` is
/// used.
struct IdentificationProblem {
    std::shared_ptr<const models::System> system;
    Eigen::VectorXd values;  ///< shape (q): all parameters, those that are not estimated hold; empty: the defaults
    std::vector<FreeModelParameter> parameters;
    std::vector<estimator::JointNormalPrior> joint_priors;
    std::vector<ModelQuantity> derived;
    std::vector<Experiment> experiments;

    MeasuredCycles measured;
    std::optional<orbits::CycleTargetOptions> cycles;  ///< `measured` is used, in this way
    bool cycles_if_needed = false;  ///< an automatic strategy uses cycles only where series are not enough
    std::optional<SeriesChoice> series;
    std::optional<WaveformChoice> waveform;
    std::optional<BranchChoice> branch;

    [[nodiscard]] const models::Coordinate& coordinate(Eigen::Index index) const {
        return system->coordinates()[static_cast<std::size_t>(index)];
    }
    [[nodiscard]] const models::Parameter& parameter(Eigen::Index index) const {
        return system->parameters()[static_cast<std::size_t>(index)];
    }
};

/// The problem with every default filled in: parameters, names, observed coordinates, errors, initial states. Without
/// any of `cycles`, `series`, `waveform` and `branch`, all series of samples or sections are used, and measured cycles
/// if they are needed.
/// @throws std::invalid_argument naming value and rule where the problem contradicts itself.
[[nodiscard]] IdentificationProblem completed(IdentificationProblem problem);

/// What there is for the stages of a strategy.
struct StrategyData {
    bool readings = false;  ///< say states that a prediction starts from
    bool cycles = false;
    bool searched = false;  ///< for cycles, in a record at hand
    bool series = false;
    bool waveform = false;
    bool branch = false;
    bool cycles_if_needed = false;  ///< nobody asks for them
};

/// Prediction, where a start can be predicted; cycles; more cycles, where they can be searched for; series; waveforms;
/// branches. Where cycles are used if needed, the series comes before them, and once more after them.
[[nodiscard]] std::vector<Stage> automatic_strategy(const StrategyData& data);
[[nodiscard]] std::vector<Stage> automatic_strategy(const IdentificationProblem& problem);

/// @throws std::invalid_argument naming the stage that needs what the problem does not have.
void check_strategy(const IdentificationProblem& problem, const std::vector<Stage>& strategy);

}  // namespace orbid::identification

#pragma GCC visibility pop

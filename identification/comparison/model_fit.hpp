#pragma once

#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "identification/stages/strategy_stage.hpp"

namespace orbid::identification {

/// A problem that differs from the present one in its model or its errors, fitted to the same data.
class ModelFit {
public:
    /// @param input  of the present estimate: data, cycles, options.
    /// @param problem  may differ only in its model, parameters and matching; its name is told in details.
    /// @param nodes  of every series with nodes, see estimated_nodes(); without any: guessed.
    ModelFit(const StageInput& input, IdentificationProblem problem, std::string name, SeriesStart nodes);

    /// One stage from the values of an estimate of (partly) the same parameters; nothing is harvested.
    [[nodiscard]] StageRun fit(const Stage& stage, const estimator::Estimate& from);

    [[nodiscard]] const estimator::EstimateOptions& options() const { return input_.estimate; }
    [[nodiscard]] const orbits::CycleSearch& cycles() const { return input_.search; }
    void set_cycles(orbits::CycleSearch search) { input_.search = std::move(search); }

    ModelFit(const ModelFit&) = delete;
    ModelFit& operator=(const ModelFit&) = delete;

private:
    // Each refers to those before it.
    std::string name_;
    IdentificationProblem problem_;
    Options options_;
    EstimateSetup setup_;
    ProblemResiduals prepared_;
    StageInput input_;
};

}  // namespace orbid::identification

#pragma once

#include <vector>

#include <Eigen/Core>

#include "apps/estimation/strategy_stage.hpp"

namespace orbid::apps {

/// A job that differs from the present one in its model or its errors, fitted to the same data.
class ModelFit {
public:
    /// @param input  of the present estimate: data, cycles, options.
    /// @param job    may differ only in what the estimate reads.
    /// @param nodes  of every series with nodes, see estimated_nodes(); empty: guessed.
    ModelFit(const StageInput& input, Job job, std::vector<std::vector<Eigen::MatrixXd>> nodes);

    /// One stage from the values of an estimate of (partly) the same parameters; nothing is harvested.
    [[nodiscard]] StageRun fit(const StageJob& stage, const estimator::Estimate& from);

    [[nodiscard]] const Job& job() const { return job_; }
    [[nodiscard]] const estimator::EstimateOptions& options() const { return input_.options; }
    [[nodiscard]] const orbits::CycleSearch& cycles() const { return input_.search; }
    void set_cycles(orbits::CycleSearch search) { input_.search = std::move(search); }

    ModelFit(const ModelFit&) = delete;
    ModelFit& operator=(const ModelFit&) = delete;

private:
    // Each refers to those before it.
    Job job_;
    Workspace work_;
    EstimateSetup setup_;
    JobResiduals prepared_;
    StageInput input_;
};

}  // namespace orbid::apps

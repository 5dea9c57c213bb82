#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "apps/job/job.hpp"
#include "apps/program/check/data_check.hpp"
#include "apps/program/check/flow_rate.hpp"

namespace orbid::apps {

/// How much the experiments of a job hold, and what following the model from point to point takes.
class JobAmounts {
public:
    /// Refers to all three. @param rates  as of estimated_work()
    JobAmounts(const Job& job, const DataCheck& data, const std::vector<FlowRate>& rates)
        : job_(job), data_(data), rates_(rates) {}

    /// Points of an experiment; a section or sample with all its coordinates is one.
    [[nodiscard]] double points(std::size_t index) const;
    /// Those of the segments that take part in a fit, and the number of these segments.
    [[nodiscard]] double fitted_points(std::size_t index) const;
    [[nodiscard]] double fitted_segments(std::size_t index) const;
    [[nodiscard]] std::size_t segments(std::size_t index) const;
    /// Seconds of one core from one point of an experiment to the next.
    [[nodiscard]] double step(std::size_t index) const;
    /// The same with all derivatives of an estimate.
    [[nodiscard]] double derivative_step(std::size_t index) const;
    /// Points of an experiment's steady states that are computed: those of one turn of each orbit.
    [[nodiscard]] double waveform_points(std::size_t index) const;
    /// From one section of the model to the next, as of an experiment whose rate is known.
    [[nodiscard]] double crossing() const;
    /// Derivatives after states and parameters beside the value.
    [[nodiscard]] double directions() const;
    /// Why one of these experiments cannot be followed in a known time; empty: it can.
    [[nodiscard]] std::string obstacle(const std::vector<std::size_t>& indices) const;

private:
    [[nodiscard]] const FlowRate* rate(std::size_t index) const;

    const Job& job_;
    const DataCheck& data_;
    const std::vector<FlowRate>& rates_;
};

}  // namespace orbid::apps

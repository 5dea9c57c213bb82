#pragma once

#include <memory>
#include <utility>

#include "models/system/kernel.hpp"

namespace orbid::models {

/// A kernel that leaves everything to another one: base of those that do some of it in their own way.
class ForwardingKernel : public Kernel {
public:
    explicit ForwardingKernel(std::shared_ptr<const Kernel> other) : other_(std::move(other)) {}
    [[nodiscard]] const std::shared_ptr<const Kernel>& other() const { return other_; }

    std::string_view name() const override { return other_->name(); }
    std::string_view variant() const override { return other_->variant(); }
    Kind kind() const override { return other_->kind(); }
    bool stiff() const override { return other_->stiff(); }
    double evaluation_cost() const override { return other_->evaluation_cost(); }
    std::span<const Coordinate> coordinates() const override { return other_->coordinates(); }
    std::span<const Parameter> parameters() const override { return other_->parameters(); }
    std::span<const Coordinate> inputs() const override { return other_->inputs(); }
    std::optional<std::size_t> forcing_frequency() const override { return other_->forcing_frequency(); }
    std::span<const double> symmetry_signs() const override { return other_->symmetry_signs(); }
    double symmetry_phase_shift() const override { return other_->symmetry_phase_shift(); }
    bool smooth(const double* theta) const override { return other_->smooth(theta); }
    bool at_rest(const double* state, const double* theta) const override { return other_->at_rest(state, theta); }
    void rhs(double phase, const double* state, const double* theta, const double* input, double* f) const override {
        other_->rhs(phase, state, theta, input, f);
    }
    void rhs_derivatives(double phase, const double* state, const double* theta, const double* input,
                         std::span<const std::ptrdiff_t> free, double* derivatives) const override {
        other_->rhs_derivatives(phase, state, theta, input, free, derivatives);
    }
    void rhs_second_derivatives(double phase, const double* state, const double* theta, const double* input,
                                std::span<const std::ptrdiff_t> free, double* second, double* by_phase) const override {
        other_->rhs_second_derivatives(phase, state, theta, input, free, second, by_phase);
    }
    FlowEnd flow(const FlowStart& start, std::span<const double> durations, std::span<const std::ptrdiff_t> free,
                 const FlowOutput& output) const override {
        return other_->flow(start, durations, free, output);
    }
    std::unique_ptr<const FlowBatch> flow_batch(const FlowStarts& starts, std::span<const double> durations,
                                                std::span<const std::ptrdiff_t> free) const override {
        return other_->flow_batch(starts, durations, free);
    }
    FlowEnd crossings(const FlowStart& start, const SectionPlane& plane, std::size_t count, double longest,
                      std::span<const std::ptrdiff_t> free, const FlowOutput& output) const override {
        return other_->crossings(start, plane, count, longest, free, output);
    }
    void instrument(const double* state, const double* theta, std::span<const std::ptrdiff_t> free, double* reading,
                    double* derivative) const override {
        other_->instrument(state, theta, free, reading, derivative);
    }
    void ensemble(const double* starts, std::size_t count, double phase, std::size_t periods, const double* theta,
                  const FlowOptions& options, double* const* sections, std::size_t* columns,
                  FlowStatus* status) const override {
        other_->ensemble(starts, count, phase, periods, theta, options, sections, columns, status);
    }
    std::size_t ensemble_block() const override { return other_->ensemble_block(); }

private:
    std::shared_ptr<const Kernel> other_;
};

}  // namespace orbid::models

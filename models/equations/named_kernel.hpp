#pragma once

#include <memory>

#include "models/equations/equations.hpp"
#include "models/system/kernel.hpp"

namespace orbid::models {

/// A kernel made from equations, with the names, units and claims of their text. The kernel behind it knows numbers
/// only; its coordinates, parameters and inputs have the order of the text.
class NamedKernel final : public Kernel {
public:
    NamedKernel(std::shared_ptr<const Equations> equations, std::shared_ptr<const Kernel> computing)
        : equations_(std::move(equations)), computing_(std::move(computing)) {}

    std::string_view name() const override { return equations_->text().name; }
    std::string_view variant() const override { return {}; }
    Kind kind() const override { return equations_->kind(); }
    bool stiff() const override { return equations_->text().stiff; }
    std::span<const Coordinate> coordinates() const override { return equations_->coordinates(); }
    std::span<const Parameter> parameters() const override { return equations_->parameters(); }
    std::span<const Coordinate> inputs() const override { return equations_->inputs(); }
    std::optional<std::size_t> forcing_frequency() const override { return equations_->frequency(); }
    std::span<const double> symmetry_signs() const override {
        const auto& symmetry = equations_->text().symmetry;
        return symmetry ? std::span<const double>(symmetry->signs) : std::span<const double>{};
    }
    double symmetry_phase_shift() const override {
        const auto& symmetry = equations_->text().symmetry;
        return symmetry ? symmetry->phase_shift : 0.0;
    }
    bool smooth(const double* theta) const override { return equations_->smooth(theta); }
    bool at_rest(const double* state, const double* theta) const override { return computing_->at_rest(state, theta); }
    void rhs(double phase, const double* state, const double* theta, const double* input, double* f) const override {
        computing_->rhs(phase, state, theta, input, f);
    }
    void rhs_derivatives(double phase, const double* state, const double* theta, const double* input,
                         std::span<const std::ptrdiff_t> free, double* derivatives) const override {
        computing_->rhs_derivatives(phase, state, theta, input, free, derivatives);
    }
    void rhs_second_derivatives(double phase, const double* state, const double* theta, const double* input,
                                std::span<const std::ptrdiff_t> free, double* second, double* by_phase) const override {
        computing_->rhs_second_derivatives(phase, state, theta, input, free, second, by_phase);
    }
    FlowEnd flow(const FlowStart& start, std::span<const double> durations, std::span<const std::ptrdiff_t> free,
                 const FlowOutput& output) const override {
        return computing_->flow(start, durations, free, output);
    }
    std::unique_ptr<const FlowBatch> flow_batch(const FlowStarts& starts, std::span<const double> durations,
                                                std::span<const std::ptrdiff_t> free) const override {
        return computing_->flow_batch(starts, durations, free);
    }
    FlowEnd crossings(const FlowStart& start, const SectionPlane& plane, std::size_t count, double longest,
                      std::span<const std::ptrdiff_t> free, const FlowOutput& output) const override {
        return computing_->crossings(start, plane, count, longest, free, output);
    }
    void instrument(const double* state, const double* theta, std::span<const std::ptrdiff_t> free, double* reading,
                    double* derivative) const override {
        computing_->instrument(state, theta, free, reading, derivative);
    }
    void ensemble(const double* starts, std::size_t count, double phase, std::size_t periods, const double* theta,
                  const FlowOptions& options, double* const* sections, std::size_t* columns,
                  FlowStatus* status) const override {
        computing_->ensemble(starts, count, phase, periods, theta, options, sections, columns, status);
    }
    std::size_t ensemble_block() const override { return computing_->ensemble_block(); }

private:
    std::shared_ptr<const Equations> equations_;
    std::shared_ptr<const Kernel> computing_;
};

}  // namespace orbid::models

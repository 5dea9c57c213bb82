#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "models/system/kernel.hpp"
#include "models/system/system.hpp"

#pragma GCC visibility push(default)

namespace orbid::models {

/// A kernel as a System: checks every call, gives results their shapes, and runs what is independent in parallel.
class KernelSystem : public System {
public:
    /// @param signal  the measured inputs of a model that has some; nullptr: none given yet
    explicit KernelSystem(std::shared_ptr<const Kernel> kernel, std::shared_ptr<const InputSignal> signal = nullptr);

    /// What computes.
    [[nodiscard]] const std::shared_ptr<const Kernel>& kernel() const { return kernel_; }

    std::string_view name() const override { return kernel_->name(); }
    std::string_view variant() const override { return kernel_->variant(); }
    Kind kind() const override { return kernel_->kind(); }
    std::span<const Coordinate> coordinates() const override { return kernel_->coordinates(); }
    std::span<const Parameter> parameters() const override { return kernel_->parameters(); }
    std::optional<Symmetry> symmetry() const override;
    bool stiff() const override { return kernel_->stiff(); }
    double evaluation_cost() const override { return kernel_->evaluation_cost(); }
    std::span<const Coordinate> inputs() const override { return kernel_->inputs(); }
    std::shared_ptr<const System> with_input(std::shared_ptr<const InputSignal> signal) const override;
    std::shared_ptr<const System> with_stop(std::function<bool()> interrupted) const override;
    std::shared_ptr<const System> with_state_size(double size) const override;
    double state_size() const override { return state_size_; }
    bool smooth(const Eigen::VectorXd& theta) const override;
    double period(const Eigen::VectorXd& theta, Clock clock) const override;
    std::optional<Eigen::Index> forcing_frequency() const override;
    bool at_rest(const Eigen::VectorXd& state, const Eigen::VectorXd& theta) const override;
    Eigen::MatrixXd rhs(const Eigen::MatrixXd& states, std::span<const double> phases,
                        const Eigen::VectorXd& theta) const override;
    Eigen::MatrixXd rhs_derivatives(const Eigen::MatrixXd& states, std::span<const double> phases,
                                    const Eigen::VectorXd& theta, std::span<const Eigen::Index> free) const override;
    FlowResult flow(const Eigen::VectorXd& x0, double phase, std::span<const double> durations,
                    const Eigen::VectorXd& theta, Clock clock, const FlowOptions& options) const override;
    FlowResult flow_with_sensitivities(const Eigen::VectorXd& x0, double phase, std::span<const double> durations,
                                       const Eigen::VectorXd& theta, std::span<const Eigen::Index> free, Clock clock,
                                       const FlowOptions& options) const override;
    std::vector<FlowResult> flows(const Eigen::MatrixXd& starts, std::span<const double> phases,
                                  std::span<const double> durations, const Eigen::VectorXd& theta,
                                  std::optional<std::span<const Eigen::Index>> free, Clock clock,
                                  const FlowOptions& options) const override;
    SecondOrderResult flow_with_second_derivatives(const Eigen::VectorXd& x0, double phase,
                                                   std::span<const double> durations, const Eigen::VectorXd& theta,
                                                   std::span<const Eigen::Index> free, Clock clock,
                                                   const FlowOptions& options) const override;
    CrossingResult crossings(const Eigen::VectorXd& x0, const Section& section, std::size_t count, double longest,
                             const Eigen::VectorXd& theta, std::optional<std::span<const Eigen::Index>> free,
                             const FlowOptions& options) const override;
    ReadingResult readings(const Sensor& sensor, const Eigen::MatrixXd& states, std::span<const double> phases,
                           const Eigen::VectorXd& theta, std::optional<std::span<const Eigen::Index>> free,
                           const FlowOptions& options) const override;
    EnsembleResult ensemble(const Eigen::MatrixXd& starts, double phase, std::size_t periods,
                            const Eigen::VectorXd& theta, const FlowOptions& options) const override;
    EnsembleResult crossing_ensemble(const Eigen::MatrixXd& starts, const Section& section, std::size_t count,
                                     double longest, const Eigen::VectorXd& theta,
                                     const FlowOptions& options) const override;

private:
    [[nodiscard]] FlowStart start_of(const Eigen::VectorXd& x0, double phase, const Eigen::VectorXd& theta, Clock clock,
                                     const FlowOptions& options) const;
    /// What the kernel gets: with the question of with_stop(), and tolerances for states of state_size().
    [[nodiscard]] FlowOptions for_kernel(FlowOptions options) const;
    [[nodiscard]] const double* input_at(double phase, std::vector<double>& values) const;
    void require_input() const;
    void require_autonomous() const;

    std::shared_ptr<const Kernel> kernel_;
    std::shared_ptr<const InputSignal> signal_;
    std::function<bool()> interrupted_;
    double state_size_ = 1.0;
};

}  // namespace orbid::models

#pragma GCC visibility pop

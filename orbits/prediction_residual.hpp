#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include <Eigen/Core>

#include "estimator/residual.hpp"
#include "models/system.hpp"
#include "orbits/series.hpp"

namespace orbid::orbits {

/// A state that the data say (the sensor inverted), and the one they say follows.
struct Transition {
    Eigen::VectorXd from;   ///< shape (n)
    Eigen::VectorXd to;     ///< shape (n)
    double phase = 0.0;     ///< [rad] at `from`
    double duration = 0.0;  ///< of the clock of the residual: [rad] between sections, [s] between samples
};

/// At most `count` transitions of a series over one interval, spread over the whole record at random (`seed`); nodes
/// from the readings by inverting the sensor at theta, unread coordinates from slopes. Readings that are missing make
/// no transition.
/// @param interval  sampling intervals per transition, > 0.
[[nodiscard]] std::vector<Transition> transitions(const models::System& system, const Eigen::VectorXd& theta,
                                                  const Series& series, const models::Sensor& sensor,
                                                  const std::vector<std::size_t>& segments, Eigen::Index interval,
                                                  std::size_t count, std::uint64_t seed);

/// Prediction over one interval with the nodes pinned to the data: parameters alone, no latent states, no trajectory
/// longer than an interval. The first stage, for starts far from the truth (stage 0).
///
///     e = to - Phi(from; theta),  divided by sqrt(0.01 + amplification^2) of the coordinate, Cauchy errors
///
/// whose scale is estimated: what a transition is worth falls with how strongly errors of its start are amplified at
/// the parameters of the last refresh(), and gross errors hardly count.
class PredictionResidual final : public estimator::Residual {
public:
    PredictionResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                       std::vector<Transition> transitions, models::Clock clock, const Eigen::VectorXd& start,
                       const models::FlowOptions& flow = {1e-9, 1e-9, 20000});

    [[nodiscard]] std::string_view type() const override { return "prediction"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return groups_; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return layout_; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return estimator::LatentStructure::none; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override;
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override;
    /// Amplifications at theta.
    estimator::RefreshReport refresh(const Eigen::VectorXd& theta, const std::vector<Eigen::VectorXd>& latents,
                                     const Eigen::VectorXd& scales) override;
    void suspend(std::size_t block) override { layout_.at(block).active = false; }

    /// How badly theta predicts, robustly, as OnePeriodResidual::misfit: what a scan over the bounds compares.
    [[nodiscard]] double misfit(const Eigen::VectorXd& theta) const;

private:
    std::vector<estimator::Group> groups_;
    std::vector<estimator::BlockLayout> layout_;
};

}  // namespace orbid::orbits

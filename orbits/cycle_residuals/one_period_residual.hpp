#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "orbits/cycle_residuals/cycle_target.hpp"
#include "orbits/simulation/point_reading.hpp"

namespace orbid::orbits {

struct OnePeriodOptions {
    CycleTargetOptions targets;  ///< weights and errors are not used: the error of a prediction is the model's
    /// Part of a prediction's error that does not grow with the local amplification, relative to the part that does, in
    /// coordinates of unit range, > 0.
    double floor = 0.1;
    /// Cauchy's: predictions far off, of orbits on another branch of a fold, have little weight.
    estimator::ErrorDistribution errors = estimator::StudentErrors{{false, 1.0, estimator::FlatPrior{}}};
    /// 1e-10: enough for one period while the parameters are still far off.
    models::FlowOptions flow{1e-10, 1e-10, 2000};
};

/// One-period prediction: every measured point of a cycle starts at the one before it.
///
///     e_j = x^meas_{j+1} - Phi(x^meas_j; theta),   j mod p, angles wrapped
///
/// It has no latent states, no orbits to lose, and no trajectory longer than a period: the first stage, for starts far
/// from the truth. One block per cycle, groups "one_period.<coordinate>". The deviation of a record is
/// sqrt(floor^2 + |its row of X_j|^2) (scaled to unit ranges), X_j the derivative of the section map: the weight of a
/// point falls as its error and the model's are amplified. Scales are 1.4826 times the median of |e| over its
/// deviation, but at least 1e-4 of the range. Both, and the states of points that are readings, are those at the start
/// parameters or the last update_active_set(). Sets are intermediate stages until neither moves by a tenth.
class OnePeriodResidual final : public estimator::Residual {
public:
    /// @param system, cycles  the system is kept by pointer; needed data of the cycles are copied.
    /// @param start           the estimator's vector at the start.
    /// @throws std::invalid_argument as select_targets, or floor not > 0.
    OnePeriodResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                      const std::vector<Cycle>& cycles, const SectionPlace& place, const Eigen::VectorXd& start,
                      const OnePeriodOptions& options = {});

    [[nodiscard]] std::string_view type() const override { return "one_period"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return initial_.groups; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return initial_.layout; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return estimator::LatentStructure::none; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return initial_.latents; }
    [[nodiscard]] estimator::ActiveSet initial_set() const override { return initial_; }
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet& active,
                                                              const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override;
    /// States, amplifications and scales at theta.
    estimator::RefreshReport update_active_set(estimator::ActiveSet& active, const Eigen::VectorXd& theta,
                                               const std::vector<Eigen::VectorXd>& latents,
                                               const Eigen::VectorXd& scales) const override;

    /// Robust measure of theta's prediction errors: sum over all records of ln(1 + (e / (0.02 range))^2). A prediction
    /// far off counts little more than one slightly off, so that the minimum is broad and few points do not decide. A
    /// block that cannot be evaluated counts as off by half the range. States are those at the start.
    [[nodiscard]] double misfit(const Eigen::VectorXd& theta) const;

    /// Cycles left out because they are states of rest.
    [[nodiscard]] const std::vector<std::size_t>& at_rest() const { return targets_.at_rest; }

private:
    /// Deviations of all records and scales of a set at these parameters. @return how much the typical one moved (ln)
    double weigh(estimator::ActiveSet& active, const Eigen::VectorXd& values) const;
    /// The states of a cycle's points, shape (n, p).
    [[nodiscard]] Eigen::Map<const Eigen::MatrixXd> nodes(const estimator::ActiveSet& active, std::size_t block) const;

    std::shared_ptr<const models::System> system_;
    models::ParameterBinding binding_;
    SectionMap map_;
    PointReading reading_;
    double floor_;
    CycleTargets targets_;
    Eigen::VectorXd range_;
    estimator::ActiveSet initial_;  ///< memory: the states of each cycle's points, then the number of updates
};

/// A better start for the one-period prediction: each parameter in turn is tried on a coarse ladder around its start
/// (factors 2^(k/6), k = -12 .. 12; around 0: +- size 2^(k/2), k = -6 .. 6), in two rounds. The value with the smallest
/// misfit (OnePeriodResidual::misfit, PredictionResidual::misfit) is kept. The start is the first candidate, so a good
/// one stays.
///
/// The misfit has other minima, which a ladder steps over. All of 100 starts with a length within a factor of 2 and
/// frictions within a factor of 10, at point errors of 1e-4 and of 1e-3, led to the optimum; without it 33 of 40.
///
/// @param start, lower, upper, size  one per estimated parameter; candidates outside [lower, upper] are not tried.
/// @throws std::invalid_argument on wrong lengths.
/// Cost: 50 predictions of all points per parameter.
[[nodiscard]] Eigen::VectorXd scanned_start(const std::function<double(const Eigen::VectorXd&)>& misfit,
                                            const Eigen::VectorXd& start, const Eigen::VectorXd& lower,
                                            const Eigen::VectorXd& upper, const Eigen::VectorXd& size);
[[nodiscard]] Eigen::VectorXd scanned_start(const OnePeriodResidual& residual, const Eigen::VectorXd& start,
                                            const Eigen::VectorXd& lower, const Eigen::VectorXd& upper,
                                            const Eigen::VectorXd& size);

}  // namespace orbid::orbits

#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/estimate/estimate.hpp"
#include "estimator/interface/eigen_layout.hpp"

namespace orbid::estimator {

/// A slope of the objective over parameters, beside residuals and priors: a normal prior 300 sds wide, and as far away
/// as gives this slope.
class Tilt {
public:
    Tilt() = default;
    /// @param estimate  near where the objective with the tilt has its minimum.
    /// @param slope     in natural units, shape (parameters); nan: none of this parameter.
    Tilt(const std::vector<FreeParameter>& parameters, const Estimate& estimate, const Eigen::VectorXd& slope);

    [[nodiscard]] bool empty() const { return prior_.names.empty(); }
    /// The prior; only of one that is not empty.
    [[nodiscard]] const JointNormalPrior& prior() const { return prior_; }
    /// The same options, with the tilt among their joint priors.
    [[nodiscard]] EstimateOptions with(EstimateOptions options) const;
    /// Takes the prior out of the objective that an estimate with it has.
    void take_out(const std::vector<FreeParameter>& parameters, Estimate& estimate) const;

private:
    std::vector<std::size_t> place_;  ///< of the parameters that have it
    JointNormalPrior prior_;
};

/// An estimate that begins where another one of the same residuals has ended, with its sets of blocks. Iterations and
/// evaluations count those of both.
[[nodiscard]] Estimate estimate_again(const std::vector<FreeParameter>& parameters,
                                      const std::vector<const Residual*>& residuals,
                                      const std::vector<DerivedQuantity>& derived, const EstimateOptions& options,
                                      const Estimate& before);

}  // namespace orbid::estimator

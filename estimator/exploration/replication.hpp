#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/estimate/estimate.hpp"
#include "estimator/exploration/record_draws.hpp"
#include "estimator/interface/eigen_layout.hpp"

namespace orbid::estimator {

/// The estimate from one record drawn anew.
struct BootstrapReplicate {
    std::uint64_t number = 0;
    EstimateStatus status = EstimateStatus::failed;
    std::string message;
    Eigen::VectorXd values;  ///< parameters, derived quantities, estimated error scales; empty when it failed
    Eigen::VectorXd sds;     ///< likewise; nan where undetermined or at a bound
    int evaluations = 0;
};

/// The sets of an estimate with its states, scales and shapes, to begin another one from.
[[nodiscard]] std::vector<ActiveSet> ended_sets(const Estimate& estimate);

/// Estimates from records drawn anew, each beginning at the first estimate, with its sets of blocks. A bias that was
/// taken off the estimate (Estimated::bias) is taken off each of them as well.
///
/// A normal, log-normal or joint normal prior of a parameter is a record, too: its mean is drawn anew around the
/// estimate. Other priors stay as they are.
class Replication {
public:
    /// @param options  without the tilt of the estimate.
    /// residuals, estimate and draws are not owned.
    Replication(const std::vector<FreeParameter>& parameters, const std::vector<const Residual*>& residuals,
                const std::vector<DerivedQuantity>& derived, const EstimateOptions& options, const Estimate& estimate,
                const RecordDraws& draws, std::uint64_t seed);

    /// @param mirror  of the errors of records; means of priors have none.
    [[nodiscard]] BootstrapReplicate run(std::size_t number, Mirror mirror) const;

private:
    void take_values(const Estimate& found, BootstrapReplicate& replicate) const;

    std::vector<FreeParameter> parameters_;
    const std::vector<const Residual*>& residuals_;
    const std::vector<DerivedQuantity>& derived_;
    EstimateOptions options_;
    const Estimate& estimate_;
    const RecordDraws& draws_;
    std::vector<ActiveSet> sets_;
    std::uint64_t seed_;
};

}  // namespace orbid::estimator

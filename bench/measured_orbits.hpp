#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "estimator/estimate/estimate.hpp"
#include "orbits/cycle_residuals/cycle_residual.hpp"

namespace orbid::bench {

/// The orbits of a job's model that a list of measured cycles belongs to, and what is estimated from them.
struct MeasuredOrbits {
    std::shared_ptr<const models::System> system;
    models::ParameterBinding binding;  ///< base: the job's values of all parameters
    std::vector<estimator::FreeParameter> parameters;
    std::vector<orbits::Cycle> cycles;  ///< as in the file
    std::vector<orbits::Cycle>
        exact;              ///< the model's own at the job's parameters, with multipliers; lost ones left out
    Eigen::VectorXd range;  ///< of each coordinate

    /// The job's values of the parameters that are estimated.
    [[nodiscard]] Eigen::VectorXd truth() const;
    /// As a measurement would give them: independent normal errors of `error` times the range of each coordinate, and
    /// of `multiplier_error` in ln|multiplier|, which are the covariances that are told.
    [[nodiscard]] std::vector<orbits::Cycle> noisy(double error, double multiplier_error, std::uint64_t seed) const;
};

/// @param cycles  cycles.json of the job ("orbid orbits JOB.json"); mirror images are left out.
/// @param free    estimated parameters, > 0, started at the job's values.
[[nodiscard]] MeasuredOrbits measured_orbits(const std::string& job, const std::string& cycles,
                                             const std::vector<std::string>& free);

/// Uniform numbers in (0, 1) and normal ones, the same on every platform.
class Numbers {
public:
    explicit Numbers(std::uint64_t seed) : state_(seed) {}
    [[nodiscard]] double uniform();
    [[nodiscard]] double normal();

private:
    std::uint64_t state_;
};

}  // namespace orbid::bench

#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/eigen_layout.hpp"
#include "estimator/interface/estimate_options.hpp"
#include "identification/problem/residual_choice.hpp"
#include "models/system/system.hpp"

#pragma GCC visibility push(default)

namespace orbid::identification {

/// Another model that the estimate is compared with.
struct Alternative {
    std::string name;                              ///< "variant harmonic", "without k1"
    std::shared_ptr<const models::System> system;  ///< with the same parameters; null: that of the problem
    Eigen::Index without = -1;                     ///< parameter that is 0 and not estimated; -1: none
};

/// Comparison of the estimate with other models on the same data.
struct ComparisonOptions {
    std::string model;  ///< name of the problem's own model in the result
    std::vector<Alternative> alternatives;
    double held_out = 0.0;  ///< share of the data left out in turn and predicted, in [0, 0.5]; 0: none

    [[nodiscard]] bool any() const { return !alternatives.empty() || held_out > 0.0; }
};

struct Options {
    std::vector<Stage> strategy;  ///< empty: automatic_strategy()
    bool scan = false;            ///< a prediction begins with a coarse scan of the parameters over their bounds
    std::uint64_t seed = 1;       ///< of the intervals that a prediction draws
    estimator::Variance variance = estimator::Variance::restricted;
    /// Converged when every step is below this many posterior sds, > 0. A thousandth is below what anybody can see.
    /// Much less is below the rounding of clean data, whose sds reach down to 1e-10 of the value.
    double step_tolerance = 1e-3;
    std::size_t starts = 1;        ///< >= 1; more: the estimate is repeated from starts drawn from priors and bounds
    std::uint64_t start_seed = 1;  ///< of these
    ComparisonOptions comparison;
};

/// @throws std::invalid_argument naming the option, its value and the rule.
void validate(const Options& options);

}  // namespace orbid::identification

#pragma GCC visibility pop

#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/estimate/estimate.hpp"
#include "estimator/interface/eigen_layout.hpp"

#pragma GCC visibility push(default)

namespace orbid::estimator {

struct StartedRun;

struct MultiStartOptions {
    int starts = 20;         ///< > 0, the given start included
    std::uint64_t seed = 1;  ///< of the drawn starts
    double width = 1.0;      ///< > 0: of parameters without prior and without two finite bounds, see random_start()
    /// Steps of a screening run from every start, after which only the `kept` best continue; 0: all continue.
    int screening_iterations = 0;
    int kept = 10;  ///< > 0
    /// Two ends are the same optimum when every determined parameter agrees within this many posterior sds and the
    /// objectives (in ln units) within objective_tolerance. Converged ends agree to about 1e-6 sds. A density changes
    /// by 1 % over 0.1 sds at 0.01 in ln units.
    double distance = 0.1;              ///< > 0
    double objective_tolerance = 0.01;  ///< > 0
    EstimateOptions estimate;           ///< of every run; `interrupted` is called from several threads
    /// Called after every run, one call at a time; may be empty.
    std::function<void(int finished, int total)> progress;
    /// Called after every run with its end, one call at a time; may be empty.
    std::function<void(const StartedRun& run)> ended{};
};

/// One run of a global search.
struct StartedRun {
    int start = 0;          ///< 0 = the given one
    Eigen::VectorXd from;   ///< shape (parameters), natural units
    Eigen::VectorXd theta;  ///< where it ended
    EstimateStatus status = EstimateStatus::failed;
    std::string message;
    double objective = 0.0;   ///< Phi_psi; nan when the run failed
    std::size_t records = 0;  ///< used at the end
    int evaluations = 0;
    int optimum = -1;       ///< index into MultiStart::optima; -1: no optimum (not converged, screened out)
    bool screened = false;  ///< ended after screening
};

/// Runs that ended at the same place.
struct Optimum {
    double objective = 0.0;
    Eigen::VectorXd theta;    ///< of its best run
    std::vector<int> starts;  ///< ascending
};

struct MultiStart {
    /// Of the best run; status failed, with a message, when no start could be estimated at all.
    Estimate best;
    int best_start = -1;
    std::vector<Optimum> optima;   ///< best first
    std::vector<StartedRun> runs;  ///< in the order of starts
    bool interrupted = false;      ///< not all starts were run to their ends; `best` is the best so far
};

/// Fresh residuals for one run. Calls are made one at a time, in no particular order and from several threads. The
/// results of two calls must not share anything that changes.
using ResidualFactory = std::function<std::vector<std::unique_ptr<Residual>>()>;

/// Global search: estimate() from several starts, the given one and random ones (random_start(), a stream per start).
/// The same result for any number of threads.
///
/// Ends are ordered by status (converged, singular, stopped or limited, interrupted, failed) and then by the objective.
/// Where sets of blocks differ, objectives are not directly comparable. Runs that use less than nine tenths of the
/// largest number of records then come last, and the others are ordered by objective per record.
/// @throws std::invalid_argument as estimate() does, and for starts, width, kept, distance or objective_tolerance <= 0,
///         screening_iterations < 0, an empty factory.
[[nodiscard]] MultiStart multi_start(const std::vector<FreeParameter>& parameters, const ResidualFactory& residuals,
                                     const std::vector<DerivedQuantity>& derived = {},
                                     const MultiStartOptions& options = {});

}  // namespace orbid::estimator

#pragma GCC visibility pop

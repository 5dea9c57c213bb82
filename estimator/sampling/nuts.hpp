#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/eigen_layout.hpp"
#include "estimator/sampling/hamiltonian.hpp"

#pragma GCC visibility push(default)

namespace orbid::estimator {

struct NutsOptions {
    int chains = 4;           ///< > 0, independent of each other, in parallel
    int warm_up = 500;        ///< >= 0 iterations that find step and metric and are thrown away
    int draws = 1000;         ///< > 0 per chain
    std::uint64_t seed = 1;   ///< chain c draws from the stream (seed, posterior_sample, c)
    double acceptance = 0.8;  ///< target of the mean acceptance, in (0, 1): higher = shorter steps, fewer divergences
    int maximum_depth = 10;   ///< in [1, 20]: a trajectory has at most 2^depth - 1 steps
    double spread = 1.0;      ///< >= 0: chains start at start + spread * N(0, metric); 0 = all at `start`
    /// Asked between iterations, from one thread at a time; empty = never.
    std::function<bool()> interrupted;
    /// Iterations made and wanted over all chains, from one thread at a time; may be empty.
    std::function<void(int done, int total)> progress;
};

/// Throws std::invalid_argument naming the value and the rule.
void validate(const NutsOptions& options);

struct NutsChain {
    Eigen::MatrixXd draws;      ///< shape (dimension, draws made)
    Eigen::VectorXd potential;  ///< -ln p of each draw
    Eigen::VectorXd energy;     ///< H of each draw's trajectory
    Eigen::MatrixXd metric;     ///< after warm-up, shape (dimension, dimension)
    double step = 0.0;          ///< after warm-up, in units of the metric
    double acceptance = 0.0;    ///< mean over the draws
    int divergences = 0;        ///< draws whose trajectory had an energy error of 1000 or met a place without a value
    int saturated = 0;          ///< draws whose trajectory was ended by maximum_depth
    long warm_up_evaluations = 0;
    long evaluations = 0;  ///< of the draws
};

struct NutsResult {
    std::vector<NutsChain> chains;
    bool interrupted = false;  ///< then chains may hold different numbers of draws, down to none
};

/// Samples p(x) with the No-U-Turn sampler. Trajectories double until they turn back. The draw is taken from all their
/// points with weights exp(-H), later halves preferred (multinomial variant, generalised U-turn criterion also across
/// the two halves). Step by dual averaging, dense metric from windows of the warm-up of doubling length.
///
/// Same draws for any number of threads. Cost: one evaluation with gradient per leapfrog step, 2^depth - 1 per draw.
///
/// @param start   where -ln p is finite, shape (dimension), dimension >= 1.
/// @param metric  first guess of the covariance of x, symmetric positive definite.
/// @throws std::invalid_argument when options, shapes or the metric are wrong, or the start cannot be evaluated.
/// Source: Betancourt, A conceptual introduction to Hamiltonian Monte Carlo (arXiv:1701.02434, 2017), appendix A;
///         Hoffman and Gelman, J. Machine Learning Research 15 (2014) 1593.
[[nodiscard]] NutsResult sample(const NegativeLogDensity& density, const Eigen::VectorXd& start,
                                const Eigen::MatrixXd& metric, const NutsOptions& options = {});

/// Schedule of a warm-up: the first iterations find the place, the last ones the step. Between them are windows of 25,
/// 50, 100, ... iterations, each of which ends with a new metric; the last window takes the rest.
struct WarmUpPlan {
    int skipped = 0;           ///< first iterations, in no window: 75, or 15 % of a warm-up below 150
    std::vector<int> updates;  ///< iterations, counted from 1, that end a window; none after the last 50, or 10 %
};

/// Below 20 iterations there are no windows: none would hold enough. Source: the schedule of Stan (Carpenter et al.
/// 2017), which finds 100, 150, 250, 450 and 950 for 1000 iterations.
[[nodiscard]] WarmUpPlan warm_up_plan(int warm_up);

/// Metric from a window: (n S + k M) / (n + k), k = dimension + 5. This keeps it positive definite, and a window that
/// is short for its dimension changes little.
/// @param window  the draws, shape (dimension, n), n >= 2.   @param previous  M.
[[nodiscard]] Eigen::MatrixXd renewed_metric(const Eigen::MatrixXd& window, const Eigen::MatrixXd& previous);

}  // namespace orbid::estimator

#pragma GCC visibility pop

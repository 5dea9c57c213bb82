#include "estimator/sampling/nuts.hpp"

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <cmath>
#include <mutex>
#include <stdexcept>
#include <string>

#include "estimator/sampling/dual_averaging.hpp"
#include "estimator/sampling/nuts_sampler.hpp"

namespace orbid::estimator {

namespace {

/// State that all chains share: read and written by one thread at a time.
class Watch {
public:
    Watch(const NutsOptions& options) : options_(options), total_(options.chains * (options.warm_up + options.draws)) {}

    /// False: stop. Called after every iteration of every chain.
    bool go_on() {
        const std::scoped_lock lock(mutex_);
        ++done_;
        if (options_.progress) options_.progress(done_, total_);
        if (!stopped_ && done_ < total_ && options_.interrupted && options_.interrupted()) stopped_ = true;
        return !stopped_;
    }
    [[nodiscard]] bool stopped() const { return stopped_; }

private:
    const NutsOptions& options_;
    std::mutex mutex_;
    int done_ = 0;
    int total_;
    bool stopped_ = false;
};

/// Warm-up; false when interrupted.
bool warm_up(NutsSampler& chain, const NutsOptions& options, Watch& watch) {
    chain.find_step();
    if (options.warm_up == 0) return true;
    DualAveraging step(chain.step(), options.acceptance);
    const WarmUpPlan plan = warm_up_plan(options.warm_up);
    const Eigen::Index dimension = chain.point().x.size();
    Eigen::MatrixXd window(dimension, options.warm_up);
    Eigen::Index filled = 0;
    auto update = plan.updates.begin();
    for (int i = 1; i <= options.warm_up; ++i) {
        chain.set_step(step.step());
        chain.iterate();
        step.observe(chain.acceptance());
        const bool in_window = update != plan.updates.end() && i > plan.skipped;
        if (in_window) window.col(filled++) = chain.point().x;
        if (in_window && i == *update) {
            chain.set_metric(renewed_metric(window.leftCols(filled), chain.metric()));
            chain.find_step();
            step.restart(chain.step());
            filled = 0;
            ++update;
        }
        if (!watch.go_on()) return false;
    }
    chain.set_step(step.averaged());
    return true;
}

NutsChain run(NutsSampler& chain, const Eigen::VectorXd& start, const NutsOptions& options, Watch& watch) {
    NutsChain result;
    result.draws.resize(start.size(), options.draws);
    result.potential.resize(options.draws);
    result.energy.resize(options.draws);
    chain.begin(start);
    const bool warm = warm_up(chain, options, watch);
    result.warm_up_evaluations = chain.evaluations();
    Eigen::Index made = 0;
    for (bool going = warm; going && made < options.draws; going = watch.go_on()) {
        chain.iterate();
        result.draws.col(made) = chain.point().x;
        result.potential[made] = chain.point().potential;
        result.energy[made] = chain.energy();
        result.acceptance += chain.acceptance();
        result.divergences += chain.diverged() ? 1 : 0;
        result.saturated += chain.saturated() ? 1 : 0;
        ++made;
    }
    result.draws.conservativeResize(Eigen::NoChange, made);
    result.potential.conservativeResize(made);
    result.energy.conservativeResize(made);
    if (made > 0) result.acceptance /= static_cast<double>(made);
    result.evaluations = chain.evaluations() - result.warm_up_evaluations;
    result.metric = chain.metric();
    result.step = chain.step();
    return result;
}

void require(bool rule, const std::string& message) {
    if (!rule) throw std::invalid_argument(message);
}

}  // namespace

void validate(const NutsOptions& options) {
    require(options.chains > 0, "chains = " + std::to_string(options.chains) + " must be positive");
    require(options.warm_up >= 0, "warm_up = " + std::to_string(options.warm_up) + " must not be negative");
    require(options.draws > 0, "draws = " + std::to_string(options.draws) + " must be positive");
    require(options.acceptance > 0.0 && options.acceptance < 1.0,
            "acceptance = " + std::to_string(options.acceptance) + " must lie between 0 and 1");
    require(options.maximum_depth >= 1 && options.maximum_depth <= 20,
            "maximum_depth = " + std::to_string(options.maximum_depth) + " must lie in [1, 20]");
    require(options.spread >= 0.0 && std::isfinite(options.spread),
            "spread = " + std::to_string(options.spread) + " must be finite and not negative");
}

WarmUpPlan warm_up_plan(int warm_up) {
    if (warm_up < 20) return {warm_up, {}};
    WarmUpPlan plan{75, {}};
    int last = 50;
    int window = 25;
    if (warm_up < plan.skipped + window + last) {
        plan.skipped = warm_up * 15 / 100;
        last = warm_up / 10;
        window = warm_up - plan.skipped - last;
    }
    const int end = warm_up - last;
    for (int at = plan.skipped + window; at <= end; window *= 2, at += window) {
        // A window that leaves less than the next one, twice as long, takes it all.
        if (at + 2 * window > end) at = end;
        plan.updates.push_back(at);
    }
    return plan;
}

Eigen::MatrixXd renewed_metric(const Eigen::MatrixXd& window, const Eigen::MatrixXd& previous) {
    const auto n = static_cast<double>(window.cols());
    const Eigen::VectorXd mean = window.rowwise().mean();
    const Eigen::MatrixXd centred = window.colwise() - mean;
    const Eigen::MatrixXd covariance = centred * centred.transpose() / (n - 1.0);
    const double weight = static_cast<double>(window.rows()) + 5.0;
    return (n * covariance + weight * previous) / (n + weight);
}

NutsResult sample(const NegativeLogDensity& density, const Eigen::VectorXd& start, const Eigen::MatrixXd& metric,
                  const NutsOptions& options) {
    validate(options);
    require(start.size() > 0, "start: nothing to sample");
    require(metric.rows() == start.size() && metric.cols() == start.size(),
            "metric: must have shape (" + std::to_string(start.size()) + ", " + std::to_string(start.size()) + ")");
    require(metric.allFinite() && models::CholeskyFactor(metric).positive_definite(),
            "metric: must be symmetric and positive definite");
    PhasePoint probe;
    probe.x = start;
    evaluate(density, probe);
    require(std::isfinite(probe.potential), "start: the density cannot be evaluated there");

    NutsResult result;
    result.chains.resize(static_cast<std::size_t>(options.chains));
    Watch watch(options);
    // A density may run in parallel itself. A chain that waits for it must not take up another chain meanwhile, or both
    // would wait for the longer one.
    const NegativeLogDensity isolated = [&density](const Eigen::VectorXd& x, Eigen::VectorXd* gradient) {
        return oneapi::tbb::this_task_arena::isolate([&] { return density(x, gradient); });
    };
    oneapi::tbb::parallel_for(std::size_t{0}, result.chains.size(), [&](std::size_t c) {
        NutsSampler chain(isolated, options, metric, c);
        result.chains[c] = run(chain, start, options, watch);
    });
    result.interrupted = watch.stopped();
    return result;
}

}  // namespace orbid::estimator

#include "estimator/sampling/nuts.hpp"

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <stdexcept>
#include <string>

#include "estimator/interface/not_finite.hpp"
#include "estimator/interface/random_stream.hpp"
#include "estimator/sampling/dual_averaging.hpp"
#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::estimator {

namespace {

/// Loss of energy that no sound trajectory shows: exp(-1000) is nothing, and a step that is too long loses far more.
constexpr double divergent_loss = 1000.0;

double log_sum(double a, double b) {
    const double most = std::max(a, b);
    return std::isinf(most) ? most : most + std::log1p(std::exp(-std::abs(a - b)));
}

/// A run of consecutive points of a trajectory, in the order in which they were made.
struct Tree {
    bool whole = false;           ///< neither diverged nor turned back
    Eigen::VectorXd first, last;  ///< momenta of its ends
    Eigen::VectorXd sum;          ///< of all momenta
    double log_weight = -infinity;
    PhasePoint proposal;  ///< one of its points, drawn with weight exp(-H)
};

bool goes_on(const Eigen::VectorXd& first, const Eigen::VectorXd& last, const Eigen::VectorXd& sum) {
    return first.dot(sum) > 0.0 && last.dot(sum) > 0.0;
}

/// Whether two neighbouring runs together have not turned back. The two mixed conditions detect a trajectory that
/// turned once around, which the ends of the whole cannot.
bool goes_on(const Tree& a, const Tree& b) {
    return goes_on(a.first, b.last, a.sum + b.sum) && goes_on(a.first, b.first, a.sum + b.first) &&
           goes_on(a.last, b.last, b.sum + a.last);
}

/// One chain: a place, a step, a metric and its own random numbers.
class Chain {
public:
    Chain(const NegativeLogDensity& density, const NutsOptions& options, const Eigen::MatrixXd& metric,
          std::uint64_t index)
        : density_(density), options_(options), stream_(options.seed, RandomPurpose::posterior_sample, index) {
        set_metric(metric);
    }

    void begin(const Eigen::VectorXd& start);
    void find_step();
    void set_metric(const Eigen::MatrixXd& metric) {
        metric_ = metric;
        factor_ = models::CholeskyFactor(metric).lower();
    }
    void set_step(double step) { step_ = step; }
    void iterate();

    [[nodiscard]] const PhasePoint& point() const { return point_; }
    [[nodiscard]] const Eigen::MatrixXd& metric() const { return metric_; }
    [[nodiscard]] double step() const { return step_; }
    [[nodiscard]] double acceptance() const { return accepted_ / steps_; }  ///< of the last iteration
    [[nodiscard]] double energy() const { return energy_; }
    [[nodiscard]] bool diverged() const { return diverged_; }
    [[nodiscard]] bool saturated() const { return saturated_; }
    [[nodiscard]] long evaluations() const { return evaluations_; }

private:
    void draw_momentum() {
        point_.r.resize(point_.x.size());
        for (double& r : point_.r)
            r = stream_.normal();
    }
    void move(PhasePoint& point, double step) {
        leapfrog(density_, factor_, step, point);
        ++evaluations_;
    }
    [[nodiscard]] bool with_probability_exp(double log_probability) {
        return log_probability >= 0.0 || std::log(stream_.uniform()) < log_probability;
    }
    [[nodiscard]] Tree grow(int depth, double step, PhasePoint& edge);

    const NegativeLogDensity& density_;
    const NutsOptions& options_;
    RandomStream stream_;
    Eigen::MatrixXd metric_;
    Eigen::MatrixXd factor_;
    double step_ = 1.0;
    PhasePoint point_;
    double energy_ = 0.0;
    double accepted_ = 0.0;
    double steps_ = 0.0;
    bool diverged_ = false;
    bool saturated_ = false;
    long evaluations_ = 0;
};

void Chain::begin(const Eigen::VectorXd& start) {
    // Where the scattered start cannot be evaluated, half the distance is tried; the start itself is known to be valid.
    double distance = options_.spread;
    for (int attempt = 0; attempt < 10 && distance > 0.0; ++attempt, distance *= 0.5) {
        point_.x = start;
        draw_momentum();
        point_.x += distance * (factor_ * point_.r);
        evaluate(density_, point_);
        ++evaluations_;
        if (std::isfinite(point_.potential)) return;
    }
    point_.x = start;
    evaluate(density_, point_);
    ++evaluations_;
}

/// A step whose first acceptance crosses 0.8, by doubling or halving (Hoffman and Gelman, algorithm 4).
void Chain::find_step() {
    const double crossing = std::log(0.8);
    const auto gain = [&] {
        draw_momentum();
        PhasePoint trial = point_;
        const double before = trial.energy();
        move(trial, step_);
        const double after = trial.energy();
        return std::isfinite(after) ? before - after : -infinity;
    };
    const bool longer = gain() > crossing;
    // 2^50 covers every metric that is not absurd.
    for (int attempt = 0; attempt < 50; ++attempt) {
        step_ *= longer ? 2.0 : 0.5;
        if ((gain() > crossing) != longer) return;
    }
}

Tree Chain::grow(int depth, double step, PhasePoint& edge) {
    if (depth == 0) {
        Tree leaf;
        move(edge, step);
        const double loss = std::isfinite(edge.potential) ? edge.energy() - energy_ : infinity;
        steps_ += 1.0;
        accepted_ += std::min(1.0, std::exp(-loss));
        if (!(loss < divergent_loss)) {
            diverged_ = true;
            return leaf;
        }
        leaf.whole = true;
        leaf.first = leaf.last = leaf.sum = edge.r;
        leaf.log_weight = -loss;
        leaf.proposal = edge;
        return leaf;
    }
    Tree a = grow(depth - 1, step, edge);
    if (!a.whole) return a;
    Tree b = grow(depth - 1, step, edge);
    if (!b.whole) return b;
    const double total = log_sum(a.log_weight, b.log_weight);
    if (with_probability_exp(b.log_weight - total)) std::swap(a.proposal, b.proposal);
    a.whole = goes_on(a, b);
    a.sum += b.sum;
    a.last = std::move(b.last);
    a.log_weight = total;
    return a;
}

void Chain::iterate() {
    draw_momentum();
    energy_ = point_.energy();
    accepted_ = steps_ = 0.0;
    diverged_ = saturated_ = false;
    PhasePoint forward = point_;
    PhasePoint backward = point_;
    // In the order of time; its proposal is the draw.
    Tree trajectory{true, point_.r, point_.r, point_.r, 0.0, point_};
    for (int depth = 0;; ++depth) {
        if (depth == options_.maximum_depth) {
            saturated_ = true;
            break;
        }
        const bool ahead = stream_.uniform() < 0.5;
        Tree half = grow(depth, ahead ? step_ : -step_, ahead ? forward : backward);
        if (!half.whole) break;
        // The new half is preferred to the old one: larger moves, and the target stays invariant.
        if (with_probability_exp(half.log_weight - trajectory.log_weight))
            std::swap(trajectory.proposal, half.proposal);
        trajectory.log_weight = log_sum(trajectory.log_weight, half.log_weight);
        if (!ahead) {
            std::swap(half.first, half.last);
            std::swap(trajectory.first, half.first);
            std::swap(trajectory.last, half.last);
            std::swap(trajectory.sum, half.sum);
        }
        // Now `trajectory` is the earlier run and `half` the later one.
        const bool on = goes_on(trajectory, half);
        trajectory.sum += half.sum;
        trajectory.last = std::move(half.last);
        if (!on) break;
    }
    point_ = std::move(trajectory.proposal);
}

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
bool warm_up(Chain& chain, const NutsOptions& options, Watch& watch) {
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

NutsChain run(Chain& chain, const Eigen::VectorXd& start, const NutsOptions& options, Watch& watch) {
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
        Chain chain(isolated, options, metric, c);
        result.chains[c] = run(chain, start, options, watch);
    });
    result.interrupted = watch.stopped();
    return result;
}

}  // namespace orbid::estimator

#include "estimator/sampling/nuts_sampler.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace orbid::estimator {

namespace {

/// Loss of energy that no sound trajectory shows: exp(-1000) is nothing, and a step that is too long loses far more.
constexpr double divergent_loss = 1000.0;

double log_sum(double a, double b) {
    const double most = std::max(a, b);
    return std::isinf(most) ? most : most + std::log1p(std::exp(-std::abs(a - b)));
}

bool goes_on(const Eigen::VectorXd& first, const Eigen::VectorXd& last, const Eigen::VectorXd& sum) {
    return first.dot(sum) > 0.0 && last.dot(sum) > 0.0;
}

/// Whether two neighbouring runs together have not turned back. The two mixed conditions detect a trajectory that
/// turned once around, which the ends of the whole cannot.
bool goes_on(const Trajectory& a, const Trajectory& b) {
    return goes_on(a.first, b.last, a.sum + b.sum) && goes_on(a.first, b.first, a.sum + b.first) &&
           goes_on(a.last, b.last, b.sum + a.last);
}

}  // namespace

void NutsSampler::begin(const Eigen::VectorXd& start) {
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
void NutsSampler::find_step() {
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

Trajectory NutsSampler::grow(int depth, double step, PhasePoint& edge) {
    if (depth == 0) {
        Trajectory leaf;
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
    Trajectory a = grow(depth - 1, step, edge);
    if (!a.whole) return a;
    Trajectory b = grow(depth - 1, step, edge);
    if (!b.whole) return b;
    const double total = log_sum(a.log_weight, b.log_weight);
    if (with_probability_exp(b.log_weight - total)) std::swap(a.proposal, b.proposal);
    a.whole = goes_on(a, b);
    a.sum += b.sum;
    a.last = std::move(b.last);
    a.log_weight = total;
    return a;
}

void NutsSampler::iterate() {
    draw_momentum();
    energy_ = point_.energy();
    accepted_ = steps_ = 0.0;
    diverged_ = saturated_ = false;
    PhasePoint forward = point_;
    PhasePoint backward = point_;
    // In the order of time; its proposal is the draw.
    Trajectory trajectory{true, point_.r, point_.r, point_.r, 0.0, point_};
    for (int depth = 0;; ++depth) {
        if (depth == options_.maximum_depth) {
            saturated_ = true;
            break;
        }
        const bool ahead = stream_.uniform() < 0.5;
        Trajectory half = grow(depth, ahead ? step_ : -step_, ahead ? forward : backward);
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

}  // namespace orbid::estimator

#include "estimator/exploration/profile_walk.hpp"

#include <algorithm>
#include <cmath>

namespace orbid::estimator {

namespace {

/// Bisections towards a point that fails before the side is given up: the end is then known to 1/64 of a step.
constexpr int end_bisections = 6;

}  // namespace

/// Minimises at u, started from the nearest point known; keeps the nodes in order. False when that fails.
bool ProfileWalk::visit(double u) {
    ++visited_;
    std::size_t near = 0;
    for (std::size_t k = 1; k < side.nodes.size(); ++k)
        if (std::abs(side.nodes[k].u - u) < std::abs(side.nodes[near].u - u)) near = k;
    ConditionalEstimate found;
    const ConditionalStart& neighbour = side.nodes[near].at;
    for (const ConditionalStart* from : {&neighbour, &conditional_.start()}) {
        found = conditional_.at(unknown_, u, conditional_.moved(*from, unknown_, u), Variance::ml, false);
        side.evaluations += found.evaluations;
        if (found.good()) break;
    }
    const double prior = conditional_.log_prior(unknown_, u);
    if (!found.good() || !std::isfinite(prior)) {
        side.failed.push_back(conditional_.natural(unknown_, u));
        return false;
    }
    ProfileNode node{u, found.objective - prior, 0.0, found.at};
    const double rise = 2.0 * (node.objective - side.nodes.front().objective);
    node.root = rise > 0.0 ? std::sqrt(rise) : -std::sqrt(-rise);
    const auto place = std::find_if(side.nodes.begin(), side.nodes.end(),
                                    [&](const ProfileNode& other) { return direction_ * (other.u - u) > 0.0; });
    side.nodes.insert(place, std::move(node));
    return true;
}

bool ProfileWalk::stopped() {
    if (estimate_.interrupted && estimate_.interrupted()) {
        side.end = ProfileEnd::interrupted;
        return true;
    }
    return visited_ >= static_cast<std::size_t>(options_.maximum_points);
}

/// The crossing between two neighbouring nodes by secants of the signed root (Illinois rule).
void ProfileWalk::close_in(std::size_t inner, std::size_t outer) {
    double near = side.nodes[inner].u;
    double far = side.nodes[outer].u;
    double below = side.nodes[inner].root - target_;
    double above = side.nodes[outer].root - target_;
    // 2 (Phi - min) = root^2: an error of the threshold is twice that of the root.
    const double accepted = 0.5 * options_.tolerance * target_;
    double best = std::abs(below) < std::abs(above) ? near : far;
    double error = std::min(std::abs(below), std::abs(above));
    int last = 0;
    while (error > accepted && !stopped() && std::abs(far - near) > 1e-12 * (std::abs(near) + sd_)) {
        const double u = near + (far - near) * std::clamp(-below / (above - below), 0.02, 0.98);
        if (!visit(u)) return end_at(ProfileEnd::failed, near);
        const auto node =
            std::find_if(side.nodes.begin(), side.nodes.end(), [&](const ProfileNode& n) { return n.u == u; });
        const double excess = node->root - target_;
        if (std::abs(excess) < error) {
            error = std::abs(excess);
            best = u;
        }
        if (excess > 0.0) {
            far = u;
            above = excess;
            if (last > 0) below *= 0.5;
            last = 1;
        } else {
            near = u;
            below = excess;
            if (last < 0) above *= 0.5;
            last = -1;
        }
    }
    side.limit = best;
    if (error > accepted && side.end == ProfileEnd::found && std::abs(far - near) > 1e-6 * sd_)
        side.end = ProfileEnd::failed;  // the budget is spent
}

void ProfileWalk::find_end() {
    const double origin = side.nodes.front().u;
    double step = target_ * sd_;
    int halved = 0;
    while (!stopped()) {
        const ProfileNode last = side.nodes.back();
        double u = last.u + direction_ * step;
        const bool at_limit = std::isfinite(limit_) && direction_ * (limit_ - u) <= 0.0;
        if (at_limit) u = limit_;
        if (!(direction_ * (u - last.u) > 1e-9 * sd_)) return end_at(ProfileEnd::bound, limit_);
        if (!visit(u)) {
            if (++halved > end_bisections) return end_at(ProfileEnd::failed, last.u);
            step *= 0.5;
            continue;
        }
        const double root = side.nodes.back().root;
        if (root >= target_) return close_in(side.nodes.size() - 2, side.nodes.size() - 1);
        if (at_limit) return end_at(ProfileEnd::bound, limit_);
        if (std::abs(u - origin) > options_.reach * sd_) return end_at(ProfileEnd::open, limit_);
        // A straight line to the target, a little beyond. Not faster than steps that were halved for points that fail.
        const double slope = (root - last.root) / std::abs(u - last.u);
        const double wanted = slope > 0.0 ? 1.05 * (target_ - root) / slope : 3.0 * step;
        step = std::clamp(wanted, 0.2 * step, (halved > 0 ? 1.0 : 3.0) * step);
    }
    end_at(side.end == ProfileEnd::interrupted ? side.end : ProfileEnd::failed, side.nodes.back().u);
}

void ProfileWalk::draw_curve() {
    if (options_.curve_points == 0 || side.nodes.size() < 2) return;
    const double last = direction_ * (side.limit - side.nodes.front().u);
    const double top = std::isfinite(last) ? target_ : side.nodes.back().root;
    const double gap = 1.3 * top / options_.curve_points;
    for (std::size_t k = 0; k + 1 < side.nodes.size() && !stopped();) {
        const ProfileNode& a = side.nodes[k];
        const ProfileNode& b = side.nodes[k + 1];
        const bool outside = direction_ * (a.u - side.nodes.front().u) >= last;
        const double parts = std::ceil((b.root - a.root) / gap);
        if (outside || !(parts > 1.0) || !visit(a.u + (b.u - a.u) / parts)) ++k;
    }
}

}  // namespace orbid::estimator

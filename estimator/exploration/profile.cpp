#include "estimator/exploration/profile.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>
#include <tbb/partitioner.h>
#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/students_t.hpp>

#include "estimator/exploration/conditional_estimate.hpp"
#include "estimator/interface/not_finite.hpp"

namespace orbid::estimator {

namespace {

/// Bisections towards a point that fails before the side is given up: the end is then known to 1/64 of a step.
constexpr int end_bisections = 6;

void check_profile(const ProfileOptions& options) {
    const auto positive = [](const std::string& what, double value) {
        if (!(value > 0.0)) throw std::invalid_argument(what + " = " + std::to_string(value) + " must be positive");
    };
    if (!(options.level > 0.0) || !(options.level < 1.0))
        throw std::invalid_argument("level = " + std::to_string(options.level) + " must lie between 0 and 1");
    positive("tolerance", options.tolerance);
    positive("reach", options.reach);
    positive("maximum_points", options.maximum_points);
    if (options.curve_points < 0)
        throw std::invalid_argument("curve_points = " + std::to_string(options.curve_points) + " must not be negative");
}

struct Threshold {
    double value = 0.0;
    std::string method = "profile chi2";
};

/// See profiles(). Degrees of freedom are the estimate's own.
Threshold threshold_of(const Conditional& conditional, const Unknown& unknown, const std::vector<Residual*>& residuals,
                       const Estimate& estimate, double level) {
    const boost::math::chi_squared_distribution<double> chi(1.0);
    const Threshold plain{boost::math::quantile(chi, level), "profile chi2"};
    int scales = 0;
    std::size_t covered = 0;
    std::size_t all = 0;
    for (const Unknown& other : conditional.unknowns())
        if (other.parameter < 0) {
            if (other.error != "scale") return plain;
            ++scales;
        }
    for (const Residual* residual : residuals) {
        if (!residual->covariances().empty()) return plain;
        for (const Group& group : residual->groups())
            if (group.scale.estimate &&
                (is_proper(group.scale.prior) || !std::holds_alternative<NormalErrors>(group.distribution)))
                return plain;
    }
    for (const EstimatedScale& scale : estimate.scales) {
        all += scale.count;
        if (scale.estimated) covered += scale.count;
    }
    if (scales != 1 || covered != all || unknown.parameter < 0) return plain;
    double determined = 0.0;
    for (const Unknown& other : conditional.unknowns())
        if (other.parameter >= 0 && std::isfinite(other.sd)) determined += 1.0;
    const double dof = estimate.degrees_of_freedom;
    if (!(dof > 0.0)) return plain;
    const boost::math::students_t_distribution<double> student(dof);
    const double t = boost::math::quantile(student, 0.5 + 0.5 * level);
    return {(dof + determined) * std::log1p(t * t / dof), "profile t"};
}

struct ProfileNode {
    double u = 0.0;
    double objective = 0.0;
    double root = 0.0;  ///< >= 0 away from the minimum
    ConditionalStart at;
};

struct ProfileSide {
    std::vector<ProfileNode> nodes;  ///< in the order of distance from the estimate
    std::vector<double> failed;
    ProfileEnd end = ProfileEnd::found;
    double limit = nan_value;  ///< the end, in u
    int evaluations = 0;
};

class Walk {
public:
    Walk(const Conditional& conditional, const Unknown& unknown, const EstimateOptions& estimate,
         const ProfileOptions& options, const ProfileNode& centre, double threshold, int direction)
        : conditional_(conditional),
          unknown_(unknown),
          estimate_(estimate),
          options_(options),
          target_(std::sqrt(threshold)),
          direction_(direction),
          limit_(direction < 0 ? unknown.lower : unknown.upper),
          sd_(unknown.sd > 0.0 ? unknown.sd : 0.1 * unknown.size) {
        side.nodes.push_back(centre);
    }

    void run();
    void draw_curve();

    ProfileSide side;

private:
    bool visit(double u);
    [[nodiscard]] bool stopped();
    void close_in(std::size_t inner, std::size_t outer);

    const Conditional& conditional_;
    const Unknown& unknown_;
    const EstimateOptions& estimate_;
    const ProfileOptions& options_;
    double target_;
    int direction_;
    double limit_;
    double sd_;
    std::size_t visited_ = 0;
};

/// Minimises at u, started from the nearest point known; keeps the nodes in order. False when that fails.
bool Walk::visit(double u) {
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

bool Walk::stopped() {
    if (estimate_.interrupted && estimate_.interrupted()) {
        side.end = ProfileEnd::interrupted;
        return true;
    }
    return visited_ >= static_cast<std::size_t>(options_.maximum_points);
}

/// The crossing between two neighbouring nodes by secants of the signed root (Illinois rule).
void Walk::close_in(std::size_t inner, std::size_t outer) {
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
        if (!visit(u)) {
            side.end = ProfileEnd::failed;
            side.limit = near;
            return;
        }
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

void Walk::run() {
    const double origin = side.nodes.front().u;
    double step = target_ * sd_;
    int halved = 0;
    while (!stopped()) {
        const ProfileNode last = side.nodes.back();
        double u = last.u + direction_ * step;
        const bool at_limit = std::isfinite(limit_) && direction_ * (limit_ - u) <= 0.0;
        if (at_limit) u = limit_;
        if (!(direction_ * (u - last.u) > 1e-9 * sd_)) {
            side.end = ProfileEnd::bound;
            side.limit = limit_;
            return;
        }
        if (!visit(u)) {
            if (++halved > end_bisections) {
                side.end = ProfileEnd::failed;
                side.limit = last.u;
                return;
            }
            step *= 0.5;
            continue;
        }
        const double root = side.nodes.back().root;
        if (root >= target_) {
            close_in(side.nodes.size() - 2, side.nodes.size() - 1);
            return;
        }
        if (at_limit) {
            side.end = ProfileEnd::bound;
            side.limit = limit_;
            return;
        }
        if (std::abs(u - origin) > options_.reach * sd_) {
            side.end = ProfileEnd::open;
            side.limit = limit_;
            return;
        }
        // A straight line to the target, a little beyond; up to three times the last step where it is flat. Steps were
        // halved for points that fail: then no faster than that.
        const double slope = (root - last.root) / std::abs(u - last.u);
        const double wanted = slope > 0.0 ? 1.05 * (target_ - root) / slope : 3.0 * step;
        step = std::clamp(wanted, 0.2 * step, (halved > 0 ? 1.0 : 3.0) * step);
    }
    if (side.end != ProfileEnd::interrupted) side.end = ProfileEnd::failed;
    side.limit = side.nodes.back().u;
}

/// Fills the gaps of the signed root within the interval.
void Walk::draw_curve() {
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

Profile profile_of(const Conditional& conditional, const Unknown& unknown, const EstimateOptions& estimate,
                   const ProfileOptions& options, const Threshold& threshold) {
    Profile result;
    result.name = unknown.name;
    result.unit = unknown.unit;
    result.value = unknown.value;
    result.threshold = threshold.value;
    result.method = threshold.method;
    result.lower = result.upper = nan_value;
    if (!std::isfinite(unknown.u)) {
        result.message = "the estimate is at an end that its scale never reaches";
        return result;
    }
    // The minimum of the profile itself, with error parameters at their maximum likelihood. The estimate may have
    // restricted ones, so the unknown moves a little.
    const ConditionalEstimate best = conditional.free(Variance::ml, false);
    result.evaluations = best.evaluations;
    if (!best.good()) {
        result.lower_end = result.upper_end =
            best.status == EstimateStatus::interrupted ? ProfileEnd::interrupted : ProfileEnd::failed;
        result.message = "the estimate by maximum likelihood: " + best.message;
        return result;
    }
    // At that minimum the unknown is held where it is: its objective is that of every other point.
    double value = unknown.value;
    if (unknown.parameter >= 0) value = best.at.theta[unknown.parameter];
    for (const auto& [error, found] : best.at.errors)
        if (unknown.parameter < 0 && error == unknown.name) value = found;
    double u = conditional.coordinate(unknown, value);
    u = std::clamp(u, unknown.lower, unknown.upper);
    const ConditionalEstimate held = conditional.at(unknown, u, best.at, Variance::ml, false);
    result.evaluations += held.evaluations;
    const double prior = conditional.log_prior(unknown, u);
    if (!held.good() || !std::isfinite(prior)) {
        result.lower_end = result.upper_end = ProfileEnd::failed;
        result.message = "the others do not converge with it held at its estimate: " + held.message;
        return result;
    }
    const ProfileNode centre{u, held.objective - prior, 0.0, held.at};
    Walk down(conditional, unknown, estimate, options, centre, threshold.value, -1);
    Walk up(conditional, unknown, estimate, options, centre, threshold.value, 1);
    const auto go = [](Walk& walk) {
        walk.run();
        walk.draw_curve();
    };
    tbb::parallel_invoke([&] { go(down); }, [&] { go(up); });
    result.value = conditional.natural(unknown, u);
    result.lower_end = down.side.end;
    result.upper_end = up.side.end;
    const auto end_of = [&](const ProfileSide& side, double open) {
        return side.end == ProfileEnd::open && !std::isfinite(side.limit) ? open
                                                                          : conditional.natural(unknown, side.limit);
    };
    result.lower = end_of(down.side, unknown.natural_lower);
    result.upper = end_of(up.side, unknown.natural_upper);
    double least = centre.objective;
    const auto add = [&](const ProfileNode& node, int sign) {
        least = std::min(least, node.objective);
        result.points.push_back({node.u, conditional.natural(unknown, node.u), node.objective, sign * node.root,
                                 conditional.expand(node.at.theta)});
    };
    for (std::size_t k = down.side.nodes.size(); k-- > 1;)
        add(down.side.nodes[k], -1);
    for (std::size_t k = 0; k < up.side.nodes.size(); ++k)
        add(up.side.nodes[k], 1);
    result.failed = down.side.failed;
    result.failed.insert(result.failed.end(), up.side.failed.begin(), up.side.failed.end());
    std::sort(result.failed.begin(), result.failed.end());
    result.evaluations += down.side.evaluations + up.side.evaluations;
    // Rounding of an objective that is a sum over many records stays far below this.
    if (centre.objective - least > 1e-6) {
        result.improvement = centre.objective - least;
        result.message = "a lower minimum than the estimate's was met on the way";
    }
    result.known = down.side.end != ProfileEnd::interrupted && up.side.end != ProfileEnd::interrupted;
    return result;
}

}  // namespace

std::string_view name(ProfileEnd end) {
    switch (end) {
        case ProfileEnd::found:
            return "found";
        case ProfileEnd::bound:
            return "bound";
        case ProfileEnd::open:
            return "open";
        case ProfileEnd::failed:
            return "failed";
        case ProfileEnd::interrupted:
            return "interrupted";
    }
    return "failed";
}

std::vector<Profile> profiles(const std::vector<FreeParameter>& parameters, const std::vector<Residual*>& residuals,
                              const EstimateOptions& options, const Estimate& estimate, const ProfileOptions& profile) {
    check_profile(profile);
    const Conditional conditional(parameters, residuals, options, estimate);
    std::vector<std::size_t> which;
    for (const std::string& wanted : profile.names)
        which.push_back(conditional.index(wanted));
    if (profile.names.empty())
        for (std::size_t k = 0; k < conditional.unknowns().size(); ++k)
            which.push_back(k);
    std::vector<Profile> result(which.size());
    tbb::parallel_for(
        std::size_t{0}, which.size(),
        [&](std::size_t k) {
            const Unknown& unknown = conditional.unknowns()[which[k]];
            result[k] = profile_of(conditional, unknown, options, profile,
                                   threshold_of(conditional, unknown, residuals, estimate, profile.level));
        },
        tbb::simple_partitioner{});
    return result;
}

}  // namespace orbid::estimator

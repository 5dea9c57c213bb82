#include "apps/results/followed_branch.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace orbid::apps {

using periodic::Bifurcation;
using periodic::Branch;

namespace {

/// The first doubling that is listed with a branch; none when there is none.
std::vector<BranchPlace> doublings_of(const std::vector<Branch>& branches, std::size_t branch) {
    std::vector<BranchPlace> places;
    for (const BranchPlace place : located_bifurcations(branches)) {
        if (place.branch != branch) continue;
        if (branches[branch].points[place.point].bifurcation == Bifurcation::period_doubling) places.push_back(place);
    }
    return places;
}

bool begins_at_doubling(const std::vector<Branch>& branches, const Branch& branch) {
    return branch.origin &&
           branches[branch.origin->branch].points[branch.origin->point].bifurcation == Bifurcation::period_doubling;
}

}  // namespace

double measure_of(const periodic::BranchPoint& point, periodic::OrbitMeasure measure, Eigen::Index index) {
    using periodic::OrbitMeasure;
    const periodic::OrbitAmplitude& of = point.amplitude;
    const auto at = [index](const Eigen::VectorXd& values) {
        return index < values.size() ? values[index] : std::numeric_limits<double>::quiet_NaN();
    };
    switch (measure) {
        case OrbitMeasure::maximum:
            return at(of.maximum);
        case OrbitMeasure::minimum:
            return at(of.minimum);
        case OrbitMeasure::mean:
            return at(of.mean);
        case OrbitMeasure::half_range:
            return at(of.half_range);
        case OrbitMeasure::rms:
            return at(of.rms);
        case OrbitMeasure::frequency:
            break;
    }
    return 1.0 / point.orbit.time;
}

std::vector<BranchPlace> located_bifurcations(const std::vector<Branch>& branches) {
    std::vector<BranchPlace> places;
    for (std::size_t b = 0; b < branches.size(); ++b) {
        const Branch& branch = branches[b];
        for (std::size_t k = 0; k < branch.points.size(); ++k) {
            if (branch.points[k].bifurcation == Bifurcation::none) continue;
            if (k == 0 && branch.origin) continue;
            if (k + 1 == branch.points.size() && branch.last == periodic::BranchEnd::other_branch) continue;
            places.push_back({b, k});
        }
    }
    return places;
}

std::vector<std::size_t> branches_from(const std::vector<Branch>& branches, BranchPlace place) {
    std::vector<std::size_t> from;
    for (std::size_t b = 0; b < branches.size(); ++b) {
        const auto& origin = branches[b].origin;
        if (origin && origin->branch == place.branch && origin->point == place.point) from.push_back(b);
    }
    return from;
}

std::vector<std::vector<BranchPlace>> doubling_cascades(const std::vector<Branch>& branches) {
    std::vector<std::vector<BranchPlace>> cascades;
    for (std::size_t b = 0; b < branches.size(); ++b) {
        if (begins_at_doubling(branches, branches[b])) continue;
        for (const BranchPlace first : doublings_of(branches, b)) {
            std::vector<BranchPlace> cascade{first};
            // A branch begins later in the list than the one it was switched from: this ends.
            for (auto next = branches_from(branches, first); !next.empty();
                 next = branches_from(branches, cascade.back())) {
                const auto doublings = doublings_of(branches, next.front());
                if (doublings.empty()) break;
                cascade.push_back(doublings.front());
            }
            if (cascade.size() > 1) cascades.push_back(std::move(cascade));
        }
    }
    return cascades;
}

int branch_period(const Branch& branch) {
    int period = 0;
    for (const periodic::BranchPoint& point : branch.points)
        period = std::max(period, point.orbit.period);
    return period;
}

std::complex<double> critical_multiplier(const periodic::PeriodicOrbit& orbit) {
    std::complex<double> nearest = std::numeric_limits<double>::quiet_NaN();
    for (const auto& multiplier : orbit.multipliers)
        if (!(std::abs(std::abs(multiplier) - 1.0) >= std::abs(std::abs(nearest) - 1.0))) nearest = multiplier;
    return nearest;
}

}  // namespace orbid::apps

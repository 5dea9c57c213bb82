#include "identification/starts/link_gaps.hpp"

#include <algorithm>
#include <cmath>
#include <variant>

#include "identification/problem/estimated_values.hpp"

namespace orbid::identification {

using Eigen::Index;
using Eigen::VectorXd;

namespace {

constexpr std::size_t most_together = 12;  ///< places in one piece

/// The largest error of a block's readings in its sds, of those with normal errors.
double reading_miss(const orbits::ShootingResidual& residual, const estimator::Estimate& estimate,
                    const estimator::ActiveSet& active, const estimator::BlockLayout& block, const VectorXd& errors) {
    double largest = 0.0;
    for (Index i = 0; i < errors.size(); ++i) {
        const auto group = static_cast<std::size_t>(block.group[static_cast<std::size_t>(i)]);
        if (group >= residual.reading_groups()) continue;
        const auto* scale = scale_of(estimate, active.groups[group].name);
        if (scale == nullptr || !(scale->value > 0.0)) continue;
        if (!std::holds_alternative<estimator::NormalErrors>(active.groups[group].distribution)) continue;
        const double sd = scale->value * (block.deviation.size() > 0 ? block.deviation[i] : 1.0);
        largest = std::max(largest, std::abs(errors[i]) / sd);
    }
    return largest;
}

}  // namespace

std::vector<std::size_t> missed_places(const orbits::ShootingResidual& residual, const estimator::Estimate& estimate,
                                       std::size_t place) {
    constexpr double most_of_a_reading = 4.5;
    const estimator::ActiveSet& active = estimate.active[place];
    const std::vector<estimator::BlockValue>& values = estimate.residuals[place];
    const VectorXd limit = 3.0 * residual.matching_sd(active);
    const auto& nodes = residual.plan().nodes;
    const auto is_linked = [&](std::size_t b) {
        return b + 1 < nodes.size() && nodes[b].linked && active.layout[b].active && active.layout[b + 1].active &&
               values[b].e.size() >= limit.size();
    };
    std::vector<std::size_t> missed;
    for (std::size_t b = 0; b < nodes.size(); ++b) {
        if (!active.layout[b].active) continue;
        const bool linked = is_linked(b);
        if ((linked && (values[b].e.tail(limit.size()).array().abs() > limit.array()).any()) ||
            reading_miss(residual, estimate, active, active.layout[b], values[b].e) > most_of_a_reading) {
            // The last node of a segment is looked at together with the one before.
            const std::size_t at = linked || b == 0 ? b : b - 1;
            if (is_linked(at) && (missed.empty() || missed.back() < at)) missed.push_back(at);
        }
    }
    return missed;
}

void add_gaps(const orbits::ShootingResidual& residual, const std::vector<std::size_t>& missed, std::size_t place,
              Index margin, std::vector<LinkGap>& gaps) {
    const auto& nodes = residual.plan().nodes;
    std::vector<std::size_t> begins;  // of segments, and the end of the last one
    for (std::size_t b = 0; b < nodes.size(); ++b)
        if (b == 0 || nodes[b].segment != nodes[b - 1].segment) begins.push_back(b);
    begins.push_back(nodes.size());
    const std::size_t before = gaps.size();
    std::size_t segment = 0;
    for (const std::size_t b : missed) {
        while (b >= begins[segment + 1])
            ++segment;
        const auto node = static_cast<Index>(b - begins[segment]);
        const bool near =
            gaps.size() > before && gaps.back().segment == segment && node <= gaps.back().missed.back() + margin;
        if (!near) gaps.push_back({place, segment, begins[segment], {}, 0, 0, {}, 0});
        gaps.back().missed.push_back(node);
    }
    std::erase_if(gaps, [](const LinkGap& gap) { return gap.missed.size() > most_together; });
    for (std::size_t g = before; g < gaps.size(); ++g) {
        LinkGap& gap = gaps[g];
        const auto all = static_cast<Index>(begins[gap.segment + 1] - gap.begin);
        gap.first = std::max<Index>(0, gap.missed.front() - margin);
        gap.count = std::min(all, gap.missed.back() + margin + 2) - gap.first;
    }
}

}  // namespace orbid::identification

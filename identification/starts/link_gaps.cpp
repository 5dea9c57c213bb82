#include "identification/starts/link_gaps.hpp"

#include <algorithm>

namespace orbid::identification {

using Eigen::Index;
using Eigen::VectorXd;

namespace {

constexpr Index margin = 4;                ///< nodes of a piece before and after those that miss
constexpr std::size_t most_together = 12;  ///< missed links in one piece

}  // namespace

std::vector<std::size_t> missed_links(const orbits::ShootingResidual& residual, const estimator::ActiveSet& active,
                                      const std::vector<estimator::BlockValue>& values) {
    const VectorXd limit = 3.0 * residual.matching_sd(active);
    const auto& nodes = residual.plan().nodes;
    std::vector<std::size_t> missed;
    for (std::size_t b = 0; b + 1 < nodes.size(); ++b) {
        if (!nodes[b].linked || !active.layout[b].active || !active.layout[b + 1].active) continue;
        if (values[b].e.size() < limit.size()) continue;
        if ((values[b].e.tail(limit.size()).array().abs() > limit.array()).any()) missed.push_back(b);
    }
    return missed;
}

void add_gaps(const orbits::ShootingResidual& residual, const std::vector<std::size_t>& missed, std::size_t place,
              std::vector<LinkGap>& gaps) {
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

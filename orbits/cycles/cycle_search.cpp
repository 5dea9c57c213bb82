#include "orbits/cycles/cycle_search.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <string>

#include "orbits/cycles/cycle_finder.hpp"
#include "orbits/cycles/cycle_time.hpp"
#include "orbits/cycles/finder_choice.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_check.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

namespace {

std::string symbolic_code(const Partition& partition, const Eigen::MatrixXd& points) {
    std::string code;
    for (Eigen::Index j = 0; j < points.cols(); ++j) {
        const double value = points(partition.coordinate, j);
        const auto above = std::upper_bound(partition.boundaries.begin(), partition.boundaries.end(), value);
        code.push_back(partition.symbols[static_cast<std::size_t>(above - partition.boundaries.begin())]);
    }
    return code;
}

}  // namespace

CycleSearch find_cycles(const Series& series, const CycleSearchOptions& options) {
    check_search(options, series.dimension());
    CycleSearch result;
    result.remarks = check_section(series, options.periods);
    const SectionPoints section(series, options.symmetry_signs);
    const std::unique_ptr<CycleFinder> finder = choose_finder(series, section, options, result);
    // Finders that fit along a sheet know the times along it.
    std::optional<NeighbourIndex> timing;
    if (section.timed()) timing.emplace(section);
    std::vector<int> periods = options.periods;
    std::sort(periods.begin(), periods.end());
    periods.erase(std::unique(periods.begin(), periods.end()), periods.end());
    for (const int period : periods) {
        std::vector<CycleCandidate> drafts = finder->find(period, result);
        if (drafts.empty()) result.missing.push_back(period);
        for (CycleCandidate& draft : drafts) {
            if (timing && std::isnan(draft.time)) time_cycle(section, *timing, draft);
            const double sd = draft.largest_sd();
            const double tolerance = same_cycle_tolerance(sd, sd, merging_boxes * options.box);
            publish(section, draft, draft.same_within.value_or(tolerance), result.cycles);
        }
    }
    if (options.partition)
        for (Cycle& cycle : result.cycles)
            cycle.code = symbolic_code(*options.partition, cycle.points);
    return result;
}

}  // namespace orbid::orbits

#include "orbits/cycle_search.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

#include "orbits/box_grid.hpp"
#include "orbits/cycle_finder.hpp"
#include "orbits/cycle_time.hpp"
#include "orbits/finder_choice.hpp"
#include "orbits/section_check.hpp"
#include "orbits/section_points.hpp"

namespace orbid::orbits {

namespace {

// Partners of a mirror pair lie no farther apart than this part of a box before they count as one.
constexpr double same_boxes = 0.3;

void validate(const Partition& partition, Eigen::Index dimension) {
    if (!(partition.coordinate >= 0 && partition.coordinate < dimension))
        throw std::invalid_argument("find_cycles: the partition's coordinate must be in [0, " +
                                    std::to_string(dimension) + "), got " + std::to_string(partition.coordinate));
    if (partition.symbols.size() != partition.boundaries.size() + 1)
        throw std::invalid_argument("find_cycles: a partition by " + std::to_string(partition.boundaries.size()) +
                                    " boundaries needs one symbol more, got " +
                                    std::to_string(partition.symbols.size()));
    for (std::size_t i = 0; i < partition.boundaries.size(); ++i)
        if (!std::isfinite(partition.boundaries[i]) ||
            (i > 0 && !(partition.boundaries[i - 1] < partition.boundaries[i])))
            throw std::invalid_argument("find_cycles: the partition's boundaries must be finite and ascending");
}

void validate(const CycleSearchOptions& options, Eigen::Index dimension) {
    if (options.periods.empty()) throw std::invalid_argument("find_cycles: periods must not be empty");
    for (const int period : options.periods)
        if (!(period >= 1 && period <= 64))
            throw std::invalid_argument("find_cycles: periods must be in [1, 64], got " + std::to_string(period));
    if (!(options.box > 0.0 && options.box < 0.5))
        throw std::invalid_argument("find_cycles: box must be in (0, 0.5), got " + std::to_string(options.box));
    if (!(options.order >= 0 && options.order <= 6))
        throw std::invalid_argument("find_cycles: order must be 1 to 6, or 0 for the data to choose, got " +
                                    std::to_string(options.order));
    if (!(options.minimum_recurrences >= 1))
        throw std::invalid_argument("find_cycles: minimum_recurrences must be at least 1, got " +
                                    std::to_string(options.minimum_recurrences));
    if (options.reading_covariance.size() > 0 &&
        !(options.reading_covariance.rows() == dimension && options.reading_covariance.cols() == dimension))
        throw std::invalid_argument("find_cycles: reading_covariance has shape (" +
                                    std::to_string(options.reading_covariance.rows()) + ", " +
                                    std::to_string(options.reading_covariance.cols()) + "), the series " +
                                    std::to_string(dimension) + " coordinates");
    if (options.partition) validate(*options.partition, dimension);
}

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
    validate(options, series.dimension());
    CycleSearch result;
    result.remarks = check_section(series, options.periods);
    const SectionPoints section(series, options.symmetry_signs);
    const std::unique_ptr<CycleFinder> finder = choose_finder(series, section, options, result);
    // Finders that fit along a sheet know the times along it.
    std::optional<BoxGrid> timing;
    if (section.timed()) timing.emplace(section);
    std::vector<int> periods = options.periods;
    std::sort(periods.begin(), periods.end());
    periods.erase(std::unique(periods.begin(), periods.end()), periods.end());
    for (const int period : periods) {
        std::vector<CycleDraft> drafts = finder->find(period, result);
        if (drafts.empty()) result.missing.push_back(period);
        for (CycleDraft& draft : drafts) {
            if (timing && std::isnan(draft.time)) time_cycle(section, *timing, draft);
            const double sd = draft.largest_sd();
            const double tolerance = same_cycle_tolerance(sd, sd, same_boxes * options.box);
            publish(section, draft, draft.same_within.value_or(tolerance), result.cycles);
        }
    }
    if (options.partition)
        for (Cycle& cycle : result.cycles)
            cycle.code = symbolic_code(*options.partition, cycle.points);
    return result;
}

}  // namespace orbid::orbits

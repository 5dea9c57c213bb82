#include "orbits/cycle_search.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

#include <Eigen/Cholesky>

#include "orbits/box_grid.hpp"
#include "orbits/cycle_finder.hpp"
#include "orbits/cycle_time.hpp"
#include "orbits/noise_level.hpp"
#include "orbits/section_check.hpp"
#include "orbits/section_points.hpp"
#include "orbits/sheet_map.hpp"

namespace orbid::orbits {

namespace {

// Fewer points tell neither the errors of readings nor a sheet.
constexpr std::size_t least_for_sheet = 300;

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

// In scaled units; as given, or estimated from the data.
Eigen::MatrixXd reading_covariance(const SectionPoints& section, const CycleSearchOptions& options) {
    const Eigen::VectorXd unit = section.scale().cwiseInverse();
    const Eigen::MatrixXd covariance = options.reading_covariance.size() > 0
                                           ? options.reading_covariance
                                           : noise_level(section, BoxGrid(section)).covariance;
    return unit.asDiagonal() * covariance * unit.asDiagonal();
}

// Mean covariance of the readings whose sds the series knows, in its units; empty when it does not know all.
Eigen::MatrixXd known_covariance(const Series& series) {
    const Eigen::Index n = series.dimension();
    Eigen::VectorXd squares = Eigen::VectorXd::Zero(n);
    double count = 0.0;
    for (const Segment& segment : series.segments) {
        if (segment.deviations.rows() != n || segment.deviations.cols() != segment.values.cols()) return {};
        for (Eigen::Index i = 0; i < segment.values.cols(); ++i) {
            if (!segment.values.col(i).allFinite()) continue;
            if (!segment.deviations.col(i).allFinite()) return {};
            squares += segment.deviations.col(i).cwiseAbs2();
            count += 1.0;
        }
    }
    if (!(count > 0.0 && squares.minCoeff() > 0.0)) return {};
    return (squares / count).asDiagonal();
}

// Along the sheet that the points of a strongly contracting flow's section lie on within their errors; nothing when
// they fill their dimensions, or when their errors are too small to be told.
std::unique_ptr<CycleFinder> finder_along_sheet(const Series& series, const SectionPoints& section,
                                                const CycleSearchOptions& options, CycleSearch& result) {
    const bool angles = std::any_of(section.angle().begin(), section.angle().end(), [](char a) { return a != 0; });
    if (section.dimension() < 2 || angles || section.image_count() < least_for_sheet) return nullptr;
    Eigen::MatrixXd covariance =
        options.reading_covariance.size() > 0 ? options.reading_covariance : known_covariance(series);
    const BoxGrid grid(section);
    if (covariance.size() == 0) {
        const NoiseLevel level = noise_level(section, grid);
        if (!level.resolved) return nullptr;
        covariance = level.covariance;
    }
    const Eigen::VectorXd unit = section.scale().cwiseInverse();
    const Eigen::MatrixXd scaled = unit.asDiagonal() * covariance * unit.asDiagonal();
    const Eigen::LLT<Eigen::MatrixXd> factor(scaled);
    if (factor.info() != Eigen::Success) return nullptr;
    const SheetMapFits fits(section, grid, factor.matrixL());
    const Eigen::Index k = fits.sheet_dimension();
    if (k == section.dimension()) return nullptr;
    result.reading_covariance = covariance;
    result.remarks.push_back("Within the errors of its readings the section is a sheet of " + std::to_string(k) +
                             (k == 1 ? " dimension" : " dimensions") +
                             "; maps were fitted along it, and cycles have the multipliers along it only.");
    return sheet_map_finder(section, options, scaled);
}

std::unique_ptr<CycleFinder> finder_for(const Series& series, const SectionPoints& section,
                                        const CycleSearchOptions& options, CycleSearch& result) {
    switch (options.method) {
        case CycleSearchOptions::Method::closest_return:
            return closest_return_finder(section, options);
        case CycleSearchOptions::Method::patch_map:
            return patch_map_finder(section, options, reading_covariance(section, options));
        case CycleSearchOptions::Method::automatic:
            if (auto finder = finder_along_sheet(series, section, options, result)) return finder;
            break;
        case CycleSearchOptions::Method::local_maps:
            break;
    }
    return local_map_finder(section, options);
}

}  // namespace

CycleSearch find_cycles(const Series& series, const CycleSearchOptions& options) {
    validate(options, series.dimension());
    CycleSearch result;
    result.remarks = check_section(series, options.periods);
    const SectionPoints section(series, options.symmetry_signs);
    const std::unique_ptr<CycleFinder> finder = finder_for(series, section, options, result);
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

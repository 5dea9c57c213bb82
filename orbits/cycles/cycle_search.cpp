#include "orbits/cycles/cycle_search.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>

#include <fmt/format.h>

#include "models/arithmetic/cholesky_factor.hpp"
#include "orbits/cycles/common_errors.hpp"
#include "orbits/cycles/cycle_finder.hpp"
#include "orbits/cycles/shared_readings.hpp"
#include "orbits/local_maps/manifold_map.hpp"
#include "orbits/local_maps/noise_level.hpp"
#include "orbits/records/refusal.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_check.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {
namespace {

using Method = CycleSearchOptions::Method;

// Fewer points tell neither the errors of readings nor a sheet.
constexpr std::size_t least_chosen_points = 300;

// Reading errors (scaled units) beyond which one map for the whole section is better than local ones. Measured on 42
// 754 sections of the pendulum (cycles up to period 5 found, all of them true; median error; largest error / sd), local
// maps against the one map: 1e-4: 181, 1.0e-4, 3.4 against 267, 2.7e-4, 7.9; 2e-4: 174, 1.6e-4, 2.8 against
// 261, 2.8e-4, 14; 3e-4: 162, 2.3e-4, 2.9 against 269, 2.9e-4, 4.3; 5e-4: 117 against 269; 1e-3: 40 against 273. Below,
// the curvature that the map does not hold is seen beside the errors of the readings.
constexpr double noisy = 3e-4;

// What the patch map can be asked for: unknowns grow with the cells of the section, time with the points (about a
// millisecond of one core each).
constexpr Eigen::Index most_coordinates = 4;
constexpr std::size_t most_points = std::size_t{1} << 18;

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

struct ReadingErrors {
    Eigen::MatrixXd covariance;  // in the coordinates' units; empty: too few points to tell
    bool resolved = false;       // false: an upper bound
};

ReadingErrors reading_errors(const Series& series, const SectionPoints& section, const CycleSearchOptions& options) {
    if (options.reading_covariance.size() > 0) return {options.reading_covariance, true};
    if (Eigen::MatrixXd known = known_covariance(series); known.size() > 0) return {std::move(known), true};
    if (section.image_count() < least_chosen_points) return {};
    const NoiseLevel level = noise_level(section, NeighbourIndex(section));
    return {level.covariance, level.resolved};
}

Eigen::MatrixXd scaled(const SectionPoints& section, const Eigen::MatrixXd& covariance) {
    const Eigen::VectorXd unit = section.scale().cwiseInverse();
    return unit.asDiagonal() * covariance * unit.asDiagonal();
}

// Dimension of the sheet that the points of a strongly contracting flow's section lie on within their errors; that of
// the section when they fill it.
Eigen::Index sheet_dimension(const SectionPoints& section, const Eigen::MatrixXd& covariance) {
    const Eigen::Index n = section.dimension();
    const bool angles = std::any_of(section.angle().begin(), section.angle().end(), [](char a) { return a != 0; });
    if (n < 2 || angles || section.image_count() < least_chosen_points) return n;
    const models::CholeskyFactor factor(covariance);
    if (!factor.positive_definite()) return n;
    const NeighbourIndex grid(section);
    return ManifoldMapFits(section, grid, factor.lower()).sheet_dimension();
}

std::unique_ptr<CycleFinder> by_the_data(const SectionPoints& section, const CycleSearchOptions& options,
                                         const ReadingErrors& errors, CycleSearch& result) {
    if (!errors.resolved) return local_map_finder(section, options);
    const Eigen::MatrixXd covariance = scaled(section, errors.covariance);
    if (const Eigen::Index k = sheet_dimension(section, covariance); k < section.dimension()) {
        result.remarks.push_back("Within the errors of its readings the section is a sheet of " + std::to_string(k) +
                                 (k == 1 ? " dimension" : " dimensions") +
                                 "; maps were fitted along it, and cycles have the multipliers along it only.");
        return sheet_map_finder(section, options, covariance);
    }
    if (std::sqrt(covariance.diagonal().maxCoeff()) <= noisy) return local_map_finder(section, options);
    if (section.dimension() > most_coordinates || section.image_count() > most_points) {
        result.remarks.emplace_back(
            "Reading errors are large for local maps; one map for the whole section (\"patch_map\") may find more "
            "cycles, but was not tried by itself: it is made for at most 4 coordinates, and takes about a millisecond "
            "of one core per point.");
        return local_map_finder(section, options);
    }
    result.spline_map = true;
    return patch_map_finder(section, options, covariance);
}

void validate_partition(const Partition& partition, Eigen::Index dimension) {
    refuse_if(!(partition.coordinate >= 0 && partition.coordinate < dimension),
              "find_cycles: the partition's coordinate must be in [0, {}), got {}", dimension, partition.coordinate);
    refuse_if(partition.symbols.size() != partition.boundaries.size() + 1,
              "find_cycles: a partition by {} boundaries needs one symbol more, got {}", partition.boundaries.size(),
              partition.symbols.size());
    for (std::size_t i = 0; i < partition.boundaries.size(); ++i)
        refuse_if(!std::isfinite(partition.boundaries[i]) ||
                      (i > 0 && !(partition.boundaries[i - 1] < partition.boundaries[i])),
                  "find_cycles: the partition's boundaries must be finite and ascending");
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

// Errors of points by those of readings, from scaled units to those of the coordinates.
ReadingShares in_units(const SectionPoints& section, ReadingShares readings, Eigen::Index coordinates) {
    for (Eigen::Index record = 0; record < std::min(readings.shares.cols(), coordinates); ++record)
        readings.shares.col(record) *= section.scale()[record % section.dimension()];
    return readings;
}

/// @param tried  starts of this period
std::string why_missing(int period, std::size_t tried) {
    if (tried == 0)
        return fmt::format(
            "no cycle of period {} was found: the record nowhere comes back near itself after {} section{}", period,
            period, period == 1 ? "" : "s");
    return fmt::format("no cycle of period {} was found: of {} near return{} none closed on a cycle", period, tried,
                       tried == 1 ? "" : "s");
}

}  // namespace

void check_search(const CycleSearchOptions& options, Eigen::Index dimension) {
    if (options.periods.empty()) throw std::invalid_argument("find_cycles: periods must not be empty");
    for (const int period : options.periods)
        refuse_if(!(period >= 1 && period <= 64), "find_cycles: periods must be in [1, 64], got {}", period);
    refuse_if(!(options.box > 0.0 && options.box < 0.5), "find_cycles: box must be in (0, 0.5), got {:f}", options.box);
    refuse_if(!(options.order >= 0 && options.order <= 6),
              "find_cycles: order must be 1 to 6, or 0 for the data to choose, got {}", options.order);
    refuse_if(!(options.minimum_recurrences >= 1), "find_cycles: minimum_recurrences must be at least 1, got {}",
              options.minimum_recurrences);
    refuse_if(options.reading_covariance.size() > 0 &&
                  !(options.reading_covariance.rows() == dimension && options.reading_covariance.cols() == dimension),
              "find_cycles: reading_covariance has shape ({}, {}), the series {} coordinates",
              options.reading_covariance.rows(), options.reading_covariance.cols(), dimension);
    if (options.partition) validate_partition(*options.partition, dimension);
}

std::unique_ptr<CycleFinder> choose_finder(const Series& series, const SectionPoints& section,
                                           const CycleSearchOptions& options, CycleSearch& result) {
    if (options.method == Method::closest_return) return closest_return_finder(section, options);
    if (options.method == Method::local_maps) return local_map_finder(section, options);
    const ReadingErrors errors = reading_errors(series, section, options);
    result.reading_covariance = errors.covariance;
    if (options.method == Method::automatic) return by_the_data(section, options, errors, result);
    result.spline_map = true;
    return patch_map_finder(section, options,
                            errors.covariance.size() > 0
                                ? scaled(section, errors.covariance)
                                : Eigen::MatrixXd(Eigen::MatrixXd::Zero(section.dimension(), section.dimension())));
}

CycleSearch find_cycles(const Series& series, const CycleSearchOptions& options) {
    check_search(options, series.dimension());
    CycleSearch result;
    result.remarks = check_section(series, options.periods);
    const SectionPoints section(series, options.symmetry_signs, {}, options.interrupted);
    std::vector<int> periods = options.periods;
    std::sort(periods.begin(), periods.end());
    periods.erase(std::unique(periods.begin(), periods.end()), periods.end());
    std::size_t done = 0;
    const auto tell = [&](const std::string& part) {
        if (options.progress) options.progress(part, done++, periods.size() + 1);
    };
    tell("reading errors and maps");
    std::vector<ReadingShares> readings;  // one per cycle
    const std::unique_ptr<CycleFinder> finder = choose_finder(series, section, options, result);
    // Finders that fit along a sheet know the times along it.
    std::optional<NeighbourIndex> timing;
    if (section.timed()) timing.emplace(section);
    for (const int period : periods) {
        tell(fmt::format("period {}, {} cycles so far", period, result.cycles.size()));
        const std::size_t tried = result.candidates, remarks = result.remarks.size();
        std::vector<CycleCandidate> drafts = finder->find(period, result);
        if (drafts.empty()) {
            result.missing.push_back(period);
            if (result.remarks.size() == remarks)
                result.remarks.push_back(why_missing(period, result.candidates - tried));
        }
        for (CycleCandidate& draft : drafts) {
            if (timing && std::isnan(draft.time)) time_cycle(section, *timing, draft);
            const double sd = draft.largest_sd();
            const double tolerance = same_cycle_tolerance(sd, sd, merging_boxes * options.box);
            const std::size_t own = result.cycles.size();
            publish(section, draft, draft.same_within.value_or(tolerance), result.cycles);
            readings.resize(result.cycles.size());
            readings[own] = in_units(section, std::move(draft.readings), draft.points.size());
        }
    }
    shorten_common_errors(result.cycles);
    share_readings(readings, result.cycles);
    if (options.partition)
        for (Cycle& cycle : result.cycles)
            cycle.code = symbolic_code(*options.partition, cycle.points);
    return result;
}

}  // namespace orbid::orbits

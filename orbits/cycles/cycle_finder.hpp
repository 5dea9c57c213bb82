#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "orbits/cycles/cycle_candidate.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/records/series.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// A method of estimating the map of a section onto itself from a series, and of closing orbits on it.
///
/// Const and thread-safe after construction; keeps a reference to the section.
class CycleFinder {
public:
    virtual ~CycleFinder() = default;

    /// The accepted cycles of one prime period, one of every mirror pair, most recurrences first. Adds to the counts
    /// (candidates, rejected) and remarks of `search`. The same with any number of threads.
    [[nodiscard]] virtual std::vector<CycleCandidate> find(int period, CycleSearch& search) const = 0;

    /// Cycles refined on these data from points near them: one entry per start, empty where not accepted. A finder with
    /// nothing to add leaves all empty.
    [[nodiscard]] virtual std::vector<std::optional<CycleCandidate>> polish(
        const std::vector<CycleCandidate>& starts) const {
        return std::vector<std::optional<CycleCandidate>>(starts.size());
    }

protected:
    CycleFinder() = default;
    CycleFinder(const CycleFinder&) = default;
    CycleFinder& operator=(const CycleFinder&) = default;
};

/// Polynomials fitted to the nearest neighbours of every point (CycleSearchOptions::Method::local_maps).
/// @throws DataError for too few points; std::invalid_argument for too few neighbours.
[[nodiscard]] std::unique_ptr<CycleFinder> local_map_finder(const SectionPoints& section,
                                                            const CycleSearchOptions& options);

/// The paper's analysis (CycleSearchOptions::Method::closest_return): in every group of recurrent points the closest
/// return is the reference x_t. A linear map without intercept relative to it is fitted at each of its p points (P5);
/// (P8) for all points.
/// @throws DataError for too few points; std::invalid_argument for too few neighbours, or an order beyond 1.
[[nodiscard]] std::unique_ptr<CycleFinder> closest_return_finder(const SectionPoints& section,
                                                                 const CycleSearchOptions& options);

/// One smooth map fitted to all data at once, with errors in points and images
/// (CycleSearchOptions::Method::spline_map).
/// @param reading_covariance_scaled  of the reading errors of a point, shape (n, n), in scaled units.
[[nodiscard]] std::unique_ptr<CycleFinder> patch_map_finder(const SectionPoints& section,
                                                            const CycleSearchOptions& options,
                                                            const Eigen::MatrixXd& reading_covariance_scaled);

/// Local polynomials along a sheet of fewer dimensions (ManifoldMap). Section points of a strongly contracting flow lie
/// on it within their reading errors. The cycles have only the multipliers along the sheet.
/// @param reading_covariance  shape (n, n), scaled units, positive definite.
[[nodiscard]] std::unique_ptr<CycleFinder> sheet_map_finder(const SectionPoints& section,
                                                            const CycleSearchOptions& options,
                                                            const Eigen::MatrixXd& reading_covariance);

/// Refuses invalid options of a search, naming the option, its value and the rule.
/// @param dimension  coordinates of the series.
/// @throws std::invalid_argument
void check_search(const CycleSearchOptions& options, Eigen::Index dimension);

/// The method of fitting the map that the options name or, with Method::automatic, the data require:
///
/// 1. along a sheet, where the points lie on fewer dimensions within their reading errors (ManifoldMapFits);
/// 2. the patch map, where reading errors exceed 3e-4 of the range: local fits cannot average them out. Not for more
///    than 4 coordinates or 2^18 points, for which it would take too long;
/// 3. local maps otherwise.
///
/// Reading errors are those of the options, else the sds that the series knows, else estimated (noise_level). They and
/// their consequences are noted in `result`.
/// @throws as the finders do.
[[nodiscard]] std::unique_ptr<CycleFinder> choose_finder(const Series& series, const SectionPoints& section,
                                                         const CycleSearchOptions& options, CycleSearch& result);

}  // namespace orbid::orbits

#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "apps/drawing/chart.hpp"
#include "apps/results/followed_branch.hpp"
#include "orbits/records/series.hpp"
#include "periodic/branches/branch.hpp"
#include "periodic/waveforms/orbit_measures.hpp"

namespace orbid::apps {

/// A band around a piece of a branch.
struct BranchBand {
    std::vector<double> x;
    std::vector<double> lower;
    std::vector<double> upper;
};

/// A motion in the picture of one measure.
struct MeasuredMark {
    double x = 0.0;
    double value = 0.0;
    double lower = 0.0;  ///< of its 95 % interval; nan: not known
    double upper = 0.0;
    std::optional<bool> stable;  ///< the model's orbit there; nothing: there is none
    std::string label;
};

/// What a picture of branches shows.
struct BranchPicture {
    orbits::SeriesCoordinate parameter;  ///< to the right
    /// Coordinate (or reading, for a measure) upwards; empty: the time T of the orbits, or their frequency.
    std::optional<Eigen::Index> shown;
    orbits::SeriesCoordinate coordinate{"T", "s", false};  ///< name and unit of what is shown upwards
    std::string title;                                     ///< for those who do not see it
    /// Of whole orbits, instead of the points of the section; with that of the frequency nothing is `shown`.
    std::optional<periodic::OrbitMeasure> measure{};
    std::vector<BranchBand> bands{};
    std::vector<MeasuredMark> measured{};
};

/// Branches as a chart: the parameter to the right, one coordinate of the points of the section (or T) upwards; stable
/// orbits solid, unstable ones dashed, coloured by period; located doublings, folds, branch points and Neimark-Sacker
/// bifurcations marked. Lines are broken where an angle leaves (-pi, pi]. Instead of the points one measure of the
/// orbits may be shown, with bands and measured motions.
[[nodiscard]] Chart branch_chart(const std::vector<periodic::Branch>& branches, const BranchPicture& picture);

/// Shows a measure of the orbits, of the coordinate that is shown, instead of the points.
void show_measure(periodic::OrbitMeasure measure, BranchPicture& picture);

/// Bands by the names of measures.
using BranchBands = std::map<std::string, std::vector<BranchBand>>;

/// Branches by the measures of measured motions beside them, one view each; without motions by those that have bands.
/// @param coordinates  of the model
[[nodiscard]] Chart measure_chart(const FollowedBranches& followed, const orbits::SeriesCoordinate& parameter,
                                  const std::vector<orbits::SeriesCoordinate>& coordinates,
                                  const BranchBands& bands = {});

}  // namespace orbid::apps

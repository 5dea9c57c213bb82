#pragma once

#include <cstddef>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "orbits/cycles/cycle.hpp"
#include "orbits/local_maps/cycle_multiplier.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {

/// What the errors of a section's points and times add to records of a cycle.
struct ReadingShares {
    std::vector<std::size_t> points;  ///< those with a share, ascending
    Eigen::MatrixXd shares;           ///< H, shape ((n + 1) points, records): H' H is the records' covariance
};

/// A closed orbit of a map fitted to the data, in the scaled units of SectionPoints, before it becomes a Cycle.
struct CycleCandidate {
    Eigen::MatrixXd points;      ///< shape (n, p), wrapped
    Eigen::MatrixXd covariance;  ///< shape (n p, n p), coordinate fastest
    CycleMultipliers multipliers;
    Eigen::MatrixXd ln_multiplier_covariance;  ///< shape (n, n)
    Eigen::MatrixXd common;                    ///< see Cycle::common; of one finder the columns mean the same for all
    double time = std::numeric_limits<double>::quiet_NaN();     ///< [s]
    double time_sd = std::numeric_limits<double>::quiet_NaN();  ///< [s]
    std::size_t recurrences = 0;
    Eigen::VectorXd advance;  ///< turns per cycle, one per angle coordinate; empty: unknown
    std::vector<std::string> quality;
    /// Solutions of one map for the whole section are the same only within this distance (scaled units), mirror images
    /// included; empty: judged by their sds.
    std::optional<double> same_within;

    Eigen::VectorXd time_covariance;  ///< with the points, shape (n p); empty: not known
    /// By the errors of the section's points and times (errors_by_readings), records as Cycle::common with the time;
    /// empty: not known. With it `covariance` knows that mirrored halves of a cycle have the same errors.
    ReadingShares readings;
    std::size_t start = 0;  ///< of its finder and period, from which it was found

    /// Largest standard deviation of a coordinate of a point.
    [[nodiscard]] double largest_sd() const;
};

/// A candidate, and whether its finder accepts it.
struct JudgedCandidate {
    CycleCandidate draft;
    bool accepted = false;
};

/// Largest coordinate of a(j) - b(j + shift) over all j, b mirrored or not. Shapes (n, p), scaled units.
[[nodiscard]] double cycle_distance(const SectionPoints& section, const Eigen::MatrixXd& a, const Eigen::MatrixXd& b,
                                    Eigen::Index shift, bool mirrored);

/// Whether all points lie within `tolerance` of each other, whichever comes first, mirrored or not.
[[nodiscard]] bool same_cycle(const SectionPoints& section, const Eigen::MatrixXd& a, const Eigen::MatrixXd& b,
                              double tolerance);

/// Whether no point repeats (within `tolerance`) before the last.
[[nodiscard]] bool is_prime(const SectionPoints& section, const Eigen::MatrixXd& points, double tolerance);

/// Two cycles with these largest sds are one when they lie within this distance: 6 sds, at least 1e-6 (starts of one
/// cycle end within 1e-7 of each other on clean data), never more than `limit`.
[[nodiscard]] double same_cycle_tolerance(double sd_a, double sd_b, double limit);

/// One draft per cycle (and mirror pair): the first with most recurrences; recurrences add up. The result is sorted by
/// descending recurrences and does not depend on the number of threads.
[[nodiscard]] std::vector<CycleCandidate> merged(
    const SectionPoints& section, std::vector<CycleCandidate> drafts,
    const std::function<double(const CycleCandidate&, const CycleCandidate&)>& tolerance_of);

/// Merged where they agree within their sds, at most within `limit`; without those that repeat before their period.
[[nodiscard]] std::vector<CycleCandidate> merged_by_sds(const SectionPoints& section,
                                                        std::vector<CycleCandidate> drafts, double limit);

/// The drafts that were accepted; `search` counts the others.
[[nodiscard]] std::vector<CycleCandidate> accepted_drafts(std::vector<JudgedCandidate> trials, CycleSearch& search);

/// Turns per cycle from those of the nearest points of the series, one per angle coordinate; empty when the series does
/// not count turns.
[[nodiscard]] Eigen::VectorXd count_turns(const SectionPoints& section, const NeighbourIndex& grid,
                                          const Eigen::MatrixXd& points);

/// The time T in which a cycle closes, and its sd, from the return times near its points:
///
///     T = sum_j tau(x_j),   var T = g' Cov(x) g + sum_j var tau_j,   g_j = d tau / dx at x_j,
///
/// where tau near x_j is a polynomial (order 1 to 3) fitted to the return times of the nearest points of the series,
/// weights (1 - (d / radius)^2)^2. Order and neighbours are those with the smallest product of the residuals' rms and
/// the root of the leverage of the place; var tau_j is the square of that product plus that of the difference to the
/// second-best fit. Neighbours are left out from the first whose image tears away from the nearest neighbour's.
///
/// Leaves time and time_sd nan when the series has no times or a point of the cycle has too few neighbours.
void time_cycle(const SectionPoints& points, const NeighbourIndex& grid, CycleCandidate& draft);

/// Mirror partners, and starts of one cycle, count as one only within this part of a box.
inline constexpr double merging_boxes = 0.3;

/// Appends a draft and, with a symmetry, its partner. A cycle within `tolerance` of its own mirror image becomes its
/// own partner: halves averaged, variances doubled.
void publish(const SectionPoints& section, const CycleCandidate& draft, double tolerance, std::vector<Cycle>& cycles);

}  // namespace orbid::orbits

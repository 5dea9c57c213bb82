#include "orbits/spline_map/spline_map_stages.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "orbits/sections/neighbour_index.hpp"
#include "orbits/spline_map/section_lift.hpp"

namespace orbid::orbits {
namespace {

// Widths of patches (scaled units): of the first maps, of the coarse one and of the finest.
constexpr double widest_patches = 0.05, coarse_patches = 0.03, fine_patches = 0.02;
// Shares of the readings' errors with which the first map ends, and with which the others begin.
constexpr double first_share = 0.1, coarse_share = 0.03;
constexpr int fine_passes = 3;

// Parts of the record that have first maps, and points of each. Turns are told from the nearest points: of more points
// these lie nearer together than readings err.
constexpr std::size_t part_count = 4;
constexpr std::size_t least_part = 16384;
constexpr std::size_t largest_part = 32768;

// Points per box of one sd of the readings' errors, if the section filled its range evenly. At 2e-2 of a pendulum's
// range 2^17 points have 46, and nearly all cycles are true. With 2^20 some are lost, and an eighth is false.
constexpr double most_per_error = 48.0;

bool turns_must_be_told(const SectionPoints& section) {
    bool angles = false;
    for (Eigen::Index d = 0; d < section.dimension(); ++d)
        angles = angles || section.is_angle(d);
    return angles && !section.turns_known();
}

SplineMapFitOptions coarse_options() {
    SplineMapFitOptions options;
    options.spacing = coarse_patches;
    options.first_share = coarse_share;
    return options;
}

// A map of widest patches, the same with turns by the first, then one of coarse patches. One that is not usable does
// not decide: those of few points may be too smooth at first.
SplineMapFit staged_map(const SectionPoints& section, const Eigen::MatrixXd& reading_covariance) {
    SplineMapFitOptions options;
    options.spacing = widest_patches;
    options.last_share = first_share;
    const SectionLift lift = lift_section(section, NeighbourIndex(section));
    SplineMapFit first = fit_spline_map(section, lift, reading_covariance, options);
    options.first_share = options.last_share = coarse_share;
    const auto next = [&](SplineMapFit before, const SplineMapFitOptions& next_options) {
        before.root = {};  // large, and of no use for the next
        return before.usable ? fit_spline_map(section, before, reading_covariance, next_options)
                             : fit_spline_map(section, lift, reading_covariance, next_options);
    };
    return next(next(std::move(first), options), coarse_options());
}

// Mean difference of two maps at some states, those beyond one of them left out.
double mean_difference(const SectionPoints& section, const SplineMap& a, const SplineMap& b,
                       const Eigen::MatrixXd& states) {
    MapValue first, second;
    double sum = 0.0;
    std::size_t count = 0;
    for (Eigen::Index t = 0; t < states.cols(); ++t) {
        if (!states.col(t).allFinite()) continue;
        a.evaluate(states.col(t).data(), 1, first);
        b.evaluate(states.col(t).data(), 1, second);
        if (!first.inside || !second.inside) continue;
        sum += section.difference(first.displacement, second.displacement).lpNorm<Eigen::Infinity>();
        ++count;
    }
    return count > 0 ? sum / static_cast<double>(count) : std::numeric_limits<double>::max();
}

// The one that differs least from the others. Not usable if none is.
std::size_t most_typical(const SectionPoints& section, const std::vector<SplineMapFit>& fits) {
    std::size_t best = 0;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < fits.size(); ++k) {
        if (!fits[k].usable) continue;
        double sum = 0.0;
        for (const SplineMapFit& other : fits)
            if (other.usable) sum += mean_difference(section, fits[k].map, other.map, other.states);
        if (!(sum < least)) continue;
        least = sum;
        best = k;
    }
    return best;
}

}  // namespace

std::optional<SectionPoints> useful_stretch(const SectionPoints& section, const Eigen::MatrixXd& reading_covariance) {
    if (!turns_must_be_told(section)) return std::nullopt;
    const double most = most_per_error / reading_covariance.diagonal().cwiseSqrt().prod();
    const double useful = std::max(most, 2.0 * static_cast<double>(least_part));
    if (static_cast<double>(section.size()) <= useful) return std::nullopt;
    return section.stretch(0, static_cast<std::size_t>(useful));
}

SplineMapFit coarse_spline_map(const SectionPoints& section, const Eigen::MatrixXd& reading_covariance) {
    if (!turns_must_be_told(section) || section.size() < 2 * least_part) return staged_map(section, reading_covariance);
    const std::size_t length = std::min(section.size() / 2, largest_part);
    std::vector<SectionPoints> parts;  // outlive their maps, which refer to them
    for (std::size_t k = 0; k < part_count; ++k)
        parts.push_back(section.stretch(k * (section.size() - length) / (part_count - 1), length));
    std::vector<SplineMapFit> fits;
    for (const SectionPoints& part : parts) {
        fits.push_back(staged_map(part, reading_covariance));
        fits.back().root = {};
    }
    return fit_spline_map(section, fits[most_typical(section, fits)], reading_covariance, coarse_options());
}

SplineMapFit fine_spline_map(const SectionPoints& section, const SplineMapFit& coarse,
                             const Eigen::MatrixXd& reading_covariance) {
    SplineMapFitOptions options;
    options.spacing = fine_patches;
    options.first_share = options.last_share;
    options.passes = fine_passes;
    return fit_spline_map(section, coarse, reading_covariance, options);
}

}  // namespace orbid::orbits

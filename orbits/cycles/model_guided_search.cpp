#include "orbits/cycles/model_guided_search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>

#include <fmt/format.h>

#include "orbits/cycles/common_errors.hpp"
#include "orbits/cycles/cycle_finder.hpp"
#include "orbits/cycles/expected_cycle.hpp"
#include "orbits/local_maps/monomials.hpp"
#include "orbits/records/refusal.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// A measured cycle belongs to an orbit when all its points lie within so many sds, predicted and measured.
constexpr double most_sds = 4.0;

// Besides those sds, relative to the range: what the flow makes of its own tolerance on an unstable orbit, below which
// clean data and model cannot be compared.
constexpr double computed_error = 1e-10;

// The series tells the map at a place when as many points as a quadratic polynomial has coefficients lie within this
// distance (scaled units), the farthest that Newton's method on local maps goes in one step. This leaves out the fixed
// point off Henon's attractor, and none of 248 orbits of the pendulum up to period 5 (2^20 or 42 754 sections).
constexpr double reach = 0.04;

// The sd (scaled units) of the points of a known cycle.
VectorXd scaled_variance(const SectionPoints& section, const Cycle& cycle) {
    const VectorXd unit = section.scale().replicate(cycle.points.cols(), 1);
    return cycle.covariance.diagonal().cwiseQuotient(unit.cwiseAbs2()).array() + computed_error * computed_error;
}

MatrixXd scaled_points(const SectionPoints& section, const Cycle& cycle) {
    MatrixXd points = section.scale().cwiseInverse().asDiagonal() * cycle.points;
    for (Index j = 0; j < points.cols(); ++j)
        points.col(j) = section.wrapped(VectorXd(points.col(j)));
    return points;
}

// A fit between two orbits tells neither: the next one must be so many times as far away (in sds). With this all 203
// cycles harvested at noise 5e-3 were true, for one that was rejected; without it (and with maps still pulled by their
// prior) 197 of 201.
constexpr double told_apart = 2.0;

// The orbit that a measured cycle is nearest to.
struct NearestOrbit {
    std::optional<std::size_t> index;                           // none within `most_sds`
    double distance = std::numeric_limits<double>::infinity();  // in sds
    double next = std::numeric_limits<double>::infinity();      // of the next orbit
};

NearestOrbit nearest_orbit(const SectionPoints& section, const std::vector<ExpectedCycle>& orbits,
                           const MatrixXd& points, const VectorXd& variance) {
    NearestOrbit result;
    for (std::size_t i = 0; i < orbits.size(); ++i) {
        const double distance = distance_in_sds(section, orbits[i], points, variance);
        if (!(distance < result.distance)) {
            result.next = std::min(result.next, distance);
            continue;
        }
        result.next = result.distance;
        result.distance = distance;
        if (distance <= most_sds) result.index = i;
    }
    return result;
}

bool visited(const NeighbourIndex& grid, const MatrixXd& points) {
    const auto needed = static_cast<std::size_t>(coefficient_count(points.rows(), 2));
    std::vector<Neighbour> near;
    for (Index j = 0; j < points.cols(); ++j) {
        grid.nearest(points.col(j), needed, near);
        if (near.size() < needed || !(near.back().distance2 <= reach * reach)) return false;
    }
    return true;
}

class ModelGuidedSearcher {
public:
    ModelGuidedSearcher(const Series& series, const std::vector<Cycle>& known, const ModelGuidedSearchOptions& options)
        : options_(options),
          section_(series, options.search.symmetry_signs, {}, options.search.interrupted),
          known_(known) {}

    [[nodiscard]] const SectionPoints& section() const { return section_; }

    ModelGuidedSearch reap(const Series& series, const std::vector<ExpectedCycle>& orbits) {
        result_.orbits = orbits.size();
        const std::vector<std::size_t> wanted = without_cycle(orbits);
        result_.candidates = wanted.size();
        const NeighbourIndex grid(section_);
        std::vector<std::size_t> tried;
        std::vector<CycleCandidate> starts;
        for (const std::size_t i : wanted) {
            if (!visited(grid, orbits[i].points)) {
                ++result_.not_visited;
                continue;
            }
            tried.push_back(i);
            starts.emplace_back();
            starts.back().points = orbits[i].points;
        }
        if (starts.empty()) return std::move(result_);
        CycleSearch search;
        if (options_.search.progress) options_.search.progress("reading errors and maps", 1, 3);
        const std::unique_ptr<CycleFinder> finder = choose_finder(series, section_, options_.search, search);
        if (options_.search.progress) options_.search.progress(fmt::format("{} starts", starts.size()), 2, 3);
        std::vector<std::optional<CycleCandidate>> fitted = finder->polish(starts);
        if (std::none_of(fitted.begin(), fitted.end(), [](const auto& draft) { return draft.has_value(); }))
            result_.remarks.emplace_back("the data close on none of the model's orbits that are not known");
        std::vector<CycleCandidate> kept;
        for (std::size_t k = 0; k < tried.size(); ++k)
            if (!fitted[k])
                ++result_.rejected;
            else if (believed(orbits, tried[k], *fitted[k], kept))
                kept.push_back(std::move(*fitted[k]));
        for (CycleCandidate& draft : kept) {
            if (section_.timed() && std::isnan(draft.time)) time_cycle(section_, grid, draft);
            draft.quality.emplace_back("looked for where the model has an orbit");
            publish(section_, draft, tolerance(draft), result_.cycles);
        }
        if (std::any_of(result_.cycles.begin(), result_.cycles.end(),
                        [](const Cycle& c) { return c.common.size() > 0; }))
            share_errors(*finder);
        return std::move(result_);
    }

private:
    // The errors that new and known cycles share: those of one map, on which the known ones are closed again.
    void share_errors(const CycleFinder& finder) {
        std::vector<std::size_t> tried;
        std::vector<CycleCandidate> starts;
        for (std::size_t c = 0; c < known_.size(); ++c) {
            if (known_[c].points.rows() != section_.dimension() || (known_[c].mirror && *known_[c].mirror < c))
                continue;
            tried.push_back(c);
            starts.emplace_back().points = scaled_points(section_, known_[c]);
        }
        const std::vector<std::optional<CycleCandidate>> fitted = finder.polish(starts);
        std::vector<Cycle> all = result_.cycles;
        std::vector<std::size_t> place(known_.size(), 0);  // in `all`; 0: not closed again (new cycles come first)
        for (std::size_t k = 0; k < tried.size(); ++k) {
            if (!fitted[k] || cycle_distance(section_, fitted[k]->points, starts[k].points, 0, false) >
                                  fitted[k]->same_within.value_or(0.0))
                continue;
            place[tried[k]] = all.size();
            publish(section_, *fitted[k], tolerance(*fitted[k]), all);
        }
        shorten_common_errors(all);
        for (std::size_t c = 0; c < result_.cycles.size(); ++c)
            result_.cycles[c].common = std::move(all[c].common);
        result_.known_common.resize(known_.size());
        for (std::size_t c = 0; c < known_.size(); ++c)
            if (place[c] > 0) result_.known_common[c] = std::move(all[place[c]].common);
    }

    // Orbits that no known cycle belongs to.
    [[nodiscard]] std::vector<std::size_t> without_cycle(const std::vector<ExpectedCycle>& orbits) const {
        std::vector<char> taken(orbits.size(), 0);
        for (const Cycle& cycle : known_) {
            if (cycle.points.rows() != section_.dimension() || cycle.covariance.rows() != cycle.points.size()) continue;
            const NearestOrbit own =
                nearest_orbit(section_, orbits, scaled_points(section_, cycle), scaled_variance(section_, cycle));
            if (own.index) taken[*own.index] = 1;
        }
        std::vector<std::size_t> result;
        for (std::size_t i = 0; i < orbits.size(); ++i)
            if (!taken[i]) result.push_back(i);
        return result;
    }

    // Whether a fit may be kept as the measured cycle of the orbit it was started from.
    bool believed(const std::vector<ExpectedCycle>& orbits, std::size_t own, const CycleCandidate& draft,
                  const std::vector<CycleCandidate>& kept) {
        const VectorXd variance = draft.covariance.diagonal().array() + computed_error * computed_error;
        if (!(distance_in_sds(section_, orbits[own], draft.points, variance, 0) <= most_sds)) {
            ++result_.rejected;
            return false;
        }
        const auto same = [&](const MatrixXd& points) {
            return points.cols() == draft.points.cols() && same_cycle(section_, points, draft.points, tolerance(draft));
        };
        const NearestOrbit nearest = nearest_orbit(section_, orbits, draft.points, variance);
        if (nearest.index == own && !(nearest.next >= told_apart * nearest.distance)) {
            ++result_.rejected;
            return false;
        }
        const bool again =
            nearest.index != own ||
            std::any_of(kept.begin(), kept.end(), [&](const CycleCandidate& other) { return same(other.points); }) ||
            std::any_of(known_.begin(), known_.end(), [&](const Cycle& cycle) {
                return cycle.points.rows() == section_.dimension() && same(scaled_points(section_, cycle));
            });
        if (again) ++result_.known;
        return !again;
    }

    // Within which two fits are one cycle (scaled units).
    [[nodiscard]] double tolerance(const CycleCandidate& draft) const {
        const double sd = draft.largest_sd();
        return draft.same_within.value_or(same_cycle_tolerance(sd, sd, merging_boxes * options_.search.box));
    }

    ModelGuidedSearchOptions options_;
    SectionPoints section_;
    const std::vector<Cycle>& known_;
    ModelGuidedSearch result_;
};

}  // namespace

ModelGuidedSearch model_guided_search(const Series& series, const models::System& system, const VectorXd& theta,
                                      const std::vector<Cycle>& known, const ModelGuidedSearchOptions& options) {
    check_search(options.search, series.dimension());
    refuse_record_if(
        options.search.method == CycleSearchOptions::Method::closest_return,
        "harvest: the method closest_return rests on recurrences of the series alone; use local_maps or patch_map");
    ModelGuidedSearcher harvester(series, known, options);
    if (options.search.progress) options.search.progress("orbits of the model", 0, 3);
    return harvester.reap(series, expected_cycles(series, harvester.section(), system, theta, options));
}

}  // namespace orbid::orbits

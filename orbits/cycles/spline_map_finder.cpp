#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include "orbits/cycles/cycle_finder.hpp"
#include "orbits/cycles/spline_map_cycle.hpp"
#include "orbits/spline_map/spline_map_fit.hpp"
#include "orbits/spline_map/spline_map_stages.hpp"

namespace orbid::orbits {
namespace {

// Largest standard deviation (scaled units) of a cycle that is told from its neighbours.
constexpr double largest_spline_sd = 0.01;

// Newton solutions of one map from different starts end within this distance.
constexpr double same_spline_distance = 1e-7;

// Newton on one map is cheap, so starts are sought from recurrences as wide as this whatever the box.
constexpr double widest_start = 0.2;

// Starts per period at most, and the size of the cells (scaled units) that take turns with their best ones.
constexpr std::size_t maximum_starts = 20000;
constexpr double start_cell = 0.01;

// A coarser map may move a point by this much (scaled units).
constexpr double largest_map_disagreement = 0.02;

// Changes of this many sds between the two maps are no chance: the patches do not follow the map there. Where it has
// kinks, an error of the order of the patches' width, the finer map is as wrong again as the change, 1 / (1.5 - 1) = 2
// of it.
constexpr double resolved = 3.0;
// Part of that error which is one vector for all points of a cycle; the rest is independent.
constexpr double common_part = 0.5;
constexpr double remarkable_map_sds = 3.0;

// Beyond this the readings' errors do not explain what the map leaves over (right: 0.97; a wrong lift: 1.2 to 1.9).
constexpr double largest_chi2 = 3.0;
constexpr double remarkable_chi2 = 1.3;

class SplineMapFinder final : public CycleFinder {
public:
    SplineMapFinder(const SectionPoints& section, const CycleSearchOptions& options,
                    const Eigen::MatrixXd& reading_covariance)
        : options_(options),
          part_(useful_stretch(section, reading_covariance)),
          section_(part_ ? *part_ : section),
          coarse_(coarse_spline_map(section_, reading_covariance)),
          fit_(fine_spline_map(section_, coarse_, reading_covariance)) {}

    [[nodiscard]] std::vector<CycleCandidate> find(int period, CycleSearch& search) const override {
        search.spline_map = true;
        if (!explains()) {
            remark(search,
                   "no smooth map explains the images of the points within the errors of the readings: no cycles");
            return {};
        }
        if (fit_.chi2 > remarkable_chi2)
            remark(search,
                   "the map leaves over more than the errors of the readings explain: they may be larger than said");
        if (part_)
            remark(search,
                   fmt::format("the map is that of the first {} points: with such errors more of them mislead it",
                               part_->size()));
        const std::vector<std::size_t> starts = recurrent(period);
        search.candidates += starts.size();
        std::vector<JudgedCandidate> closed(starts.size());
        tbb::parallel_for(std::size_t{0}, starts.size(), [&](std::size_t i) {
            closed[i] = close(fit_.states.middleCols(static_cast<Eigen::Index>(starts[i]), period), 1);
        });
        const std::vector<CycleCandidate> drafts =
            merged(section_, accepted_drafts(std::move(closed), search),
                   [](const auto&, const auto&) { return same_spline_distance; });
        std::vector<JudgedCandidate> trials(drafts.size());
        tbb::parallel_for(std::size_t{0}, drafts.size(), [&](std::size_t i) { trials[i] = judge(drafts[i]); });
        return accepted_drafts(std::move(trials), search);
    }

    [[nodiscard]] std::vector<std::optional<CycleCandidate>> polish(
        const std::vector<CycleCandidate>& starts) const override {
        std::vector<std::optional<CycleCandidate>> result(starts.size());
        if (!explains()) return result;
        tbb::parallel_for(std::size_t{0}, starts.size(), [&](std::size_t i) {
            const JudgedCandidate closed = close(starts[i].points, starts[i].recurrences);
            if (!closed.accepted) return;
            JudgedCandidate trial = judge(closed.draft);
            if (trial.accepted) result[i] = std::move(trial.draft);
        });
        return result;
    }

private:
    // The map leaves over no more than the readings' errors may.
    [[nodiscard]] bool explains() const { return coarse_.usable && fit_.usable && fit_.chi2 <= largest_chi2; }

    static void remark(CycleSearch& search, const std::string& sentence) {
        if (std::find(search.remarks.begin(), search.remarks.end(), sentence) == search.remarks.end())
            search.remarks.push_back(sentence);
    }

    // Accepted when it closes on the map, at no shorter period.
    [[nodiscard]] JudgedCandidate close(const Eigen::MatrixXd& start, std::size_t recurrences) const {
        section_.stop_if_asked();
        const SplineMapCycle cycle = close_on_spline_map(section_, fit_.map, start);
        JudgedCandidate trial;
        trial.draft.points = cycle.points;
        trial.draft.recurrences = recurrences;
        trial.accepted = cycle.converged && is_prime(section_, cycle.points, 10.0 * same_spline_distance);
        return trial;
    }

    // Covariance of a closed orbit; what a map of coarser patches makes of it tells what patches cannot follow.
    [[nodiscard]] JudgedCandidate judge(const CycleCandidate& found) const {
        section_.stop_if_asked();
        JudgedCandidate trial{draft_of(section_, fit_, found.points), false};
        CycleCandidate& draft = trial.draft;
        draft.recurrences = found.recurrences;
        draft.same_within = 10.0 * same_spline_distance;
        const SplineMapCycle refit = close_on_spline_map(section_, coarse_.map, found.points);
        if (!(refit.converged &&
              cycle_distance(section_, refit.points, found.points, 0, false) <= largest_map_disagreement))
            return trial;
        const Eigen::Index n = found.points.rows(), p = found.points.cols();
        Eigen::VectorXd change(n * p);
        for (Eigen::Index j = 0; j < p; ++j)
            change.segment(j * n, n) =
                section_.difference(Eigen::VectorXd(refit.points.col(j)), Eigen::VectorXd(found.points.col(j)));
        const Eigen::VectorXd ratio = change.cwiseQuotient(draft.covariance.diagonal().cwiseSqrt());
        const double beyond = ratio.squaredNorm() / static_cast<double>(n * p);
        const double share = 1.0 + 3.0 * beyond / (beyond + resolved * resolved);
        // The points of a cycle meet different kinks, whose errors the cycle joins: neither one vector nor independent
        // ones. As one vector alone, what is orthogonal to it counts as known: an estimate from the encoder's cycles
        // found their errors larger by factors of 2.2 (phi) and 12.6 (phi_dot), with half of it independent 0.6
        // and 1.8.
        Eigen::MatrixXd added = common_part * change * change.transpose();
        added.diagonal() += (1.0 - common_part) * change.cwiseAbs2();
        draft.covariance += share * added;
        if (beyond > remarkable_map_sds * remarkable_map_sds)
            draft.quality.emplace_back("depends on the patches' size beyond its error");
        if (p == 1 && section_.symmetric() &&
            cycle_distance(section_, found.points, found.points, 0, true) <= 10.0 * same_spline_distance)
            draft.quality.emplace_back("a fixed point by symmetry alone: perhaps a state of rest");
        const Eigen::VectorXd ln_change =
            multipliers_of(coarse_.map, refit.points).ln_modulus - draft.multipliers.ln_modulus;
        if (ln_change.allFinite()) draft.ln_multiplier_covariance += share * ln_change * ln_change.transpose();
        trial.accepted = draft.largest_sd() <= largest_spline_sd;
        return trial;
    }

    // Pieces of the smoothed series that come back within a box: the best of every cell, then the second best of each,
    // and so on. The best of all would lie around the few cycles that a long series visits most.
    [[nodiscard]] std::vector<std::size_t> recurrent(int period) const {
        const auto p = static_cast<std::size_t>(period);
        std::vector<std::pair<double, std::size_t>> found;
        std::size_t run = 0;  // images that lead up to this point without a break
        for (std::size_t i = 0; i < section_.size(); ++i) {
            if (run >= p) {
                const auto end = static_cast<Eigen::Index>(i), start = end - period;
                double gap = 0.0;
                for (Eigen::Index d = 0; d < section_.dimension(); ++d)
                    gap = std::max(gap, std::abs(section_.difference(fit_.states(d, end), fit_.states(d, start), d)));
                if (gap <= std::max(widest_start, options_.box)) found.emplace_back(gap, i - p);
            }
            run = section_.has_image(i) ? run + 1 : 0;
        }
        std::sort(found.begin(), found.end());
        std::map<std::vector<int>, std::size_t> taken;
        std::vector<std::pair<std::size_t, std::size_t>> starts;  // rank within its cell, place
        for (const auto& [gap, start] : found) {
            std::vector<int> cell;
            for (const double x : fit_.states.col(static_cast<Eigen::Index>(start)))
                cell.push_back(static_cast<int>(std::floor(x / start_cell)));
            starts.emplace_back(taken[cell]++, start);
        }
        std::stable_sort(starts.begin(), starts.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
        if (starts.size() > maximum_starts) starts.resize(maximum_starts);
        std::vector<std::size_t> places;
        for (const auto& [rank, place] : starts)
            places.push_back(place);
        return places;
    }

    CycleSearchOptions options_;
    std::optional<SectionPoints> part_;
    const SectionPoints& section_;
    SplineMapFit coarse_;
    SplineMapFit fit_;
};

}  // namespace

std::unique_ptr<CycleFinder> patch_map_finder(const SectionPoints& section, const CycleSearchOptions& options,
                                              const Eigen::MatrixXd& reading_covariance_scaled) {
    return std::make_unique<SplineMapFinder>(section, options, reading_covariance_scaled);
}

}  // namespace orbid::orbits

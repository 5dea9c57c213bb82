#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "orbits/box_grid.hpp"
#include "orbits/cycle_finder.hpp"
#include "orbits/cycle_refinement.hpp"
#include "orbits/recurrence.hpp"

namespace orbid::orbits {

namespace {

// The choice of order and neighbours where the options leave it open.
constexpr int default_order = 2;
constexpr int default_neighbours = 32;

// A neighbourhood of which the fit explains less than 99 % of the variance is no map: shuffled points leave about
// 80 %, the clean pendulum less than 1e-4.
constexpr double unexplained = 0.3;

// Standard deviation (scaled units) beyond which a cycle is not told from its neighbours (trials: 2e-3).
constexpr double largest_sd = 2e-3;

// Refits with other neighbourhoods may move a point by this much (scaled units; trials: 3e-3).
constexpr double largest_disagreement = 3e-3;

// Two solutions are one before their sds are known when they lie within this distance (scaled units): starts of one
// cycle end within 1e-7 of each other on clean data. Never farther apart than this part of a box.
constexpr double same_distance = 1e-6;
constexpr double same_boxes = 0.3;

// Refits that differ by more than this many standard deviations are remarked on.
constexpr double remarkable = 3.0;

// Noise blurs a small neighbourhood: fits of this many times the asked neighbours are tried as well.
constexpr std::array<double, 4> enlargements{1.0, 4.0, 16.0, 64.0};

// A larger neighbourhood must bring the largest standard deviation down to this part to be preferred: a smaller gain
// may be luck, and choosing the luckiest estimate makes it too small.
constexpr double worthwhile = 0.5;

struct Trial {
    CycleDraft draft;
    bool accepted = false;
    double enlargement = 1.0;  // of the neighbourhoods
};

bool explains(const RefinedCycle& cycle) {
    return std::all_of(cycle.maps.begin(), cycle.maps.end(),
                       [](const LocalMap& map) { return map.residual <= unexplained * map.image_spread; });
}

template <class Body>
void each(std::size_t count, const Body& body) {
    // Every index writes its own slot: the same bytes with any number of threads.
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count), [&](const tbb::blocked_range<std::size_t>& range) {
        for (std::size_t i = range.begin(); i < range.end(); ++i)
            body(i);
    });
}

std::vector<CycleDraft> accepted(std::vector<Trial>& trials, CycleSearch& search) {
    std::vector<CycleDraft> drafts;
    for (Trial& trial : trials)
        if (trial.accepted)
            drafts.push_back(std::move(trial.draft));
        else
            ++search.rejected;
    return drafts;
}

class LocalMapFinder final : public CycleFinder {
public:
    LocalMapFinder(const SectionPoints& section, const CycleSearchOptions& options)
        : options_(options), section_(section), grid_(section) {
        if (options_.order == 0) options_.order = default_order;
        const Eigen::Index least = coefficient_count(section.dimension(), options_.order) + 2;
        if (options_.neighbours == 0) options_.neighbours = std::max(default_neighbours, 2 * static_cast<int>(least));
        if (!(options_.neighbours >= least))
            throw std::invalid_argument("find_cycles: neighbours must be at least " + std::to_string(least) +
                                        " for this order and dimension, got " + std::to_string(options_.neighbours));
        const std::size_t points = 10 * static_cast<std::size_t>(options_.neighbours);
        if (!(section.image_count() >= points))
            throw std::invalid_argument("find_cycles: needs at least 10 x neighbours = " + std::to_string(points) +
                                        " points with an image, got " + std::to_string(section.image_count()));
    }

    [[nodiscard]] std::vector<CycleDraft> find(int period, CycleSearch& search) const override {
        const std::vector<RecurrenceSeed> seeds =
            recurrence_seeds(section_, period, options_.box, static_cast<std::size_t>(options_.minimum_recurrences));
        search.candidates += seeds.size();
        std::vector<Trial> refined(seeds.size());
        each(seeds.size(), [&](std::size_t i) { refined[i] = refine(seeds[i], period); });

        std::vector<CycleDraft> drafts =
            merged(section_, accepted(refined, search), [](const auto&, const auto&) { return same_distance; });
        std::erase_if(drafts,
                      [&](const CycleDraft& draft) { return !is_prime(section_, draft.points, same_distance); });
        std::vector<Trial> judged(drafts.size());
        each(drafts.size(), [&](std::size_t i) { judged[i] = judge(drafts[i]); });
        drafts = merged(section_, accepted(judged, search), [&](const CycleDraft& a, const CycleDraft& b) {
            return same_cycle_tolerance(a.largest_sd(), b.largest_sd(), same_boxes * options_.box);
        });
        std::erase_if(drafts, [&](const CycleDraft& draft) {
            const double sd = draft.largest_sd();
            return !is_prime(section_, draft.points, same_cycle_tolerance(sd, sd, same_boxes * options_.box));
        });
        return drafts;
    }

    [[nodiscard]] std::vector<std::optional<CycleDraft>> polish(const std::vector<CycleDraft>& starts) const override {
        std::vector<std::optional<CycleDraft>> result(starts.size());
        each(starts.size(), [&](std::size_t i) {
            Trial trial = judge(starts[i]);
            if (trial.accepted) result[i] = std::move(trial.draft);
        });
        return result;
    }

private:
    [[nodiscard]] FitChoice fit(double factor) const {
        const auto least = static_cast<double>(coefficient_count(section_.dimension(), options_.order) + 2);
        return {options_.order, static_cast<std::size_t>(
                                    std::max(least, std::ceil(factor * static_cast<double>(options_.neighbours))))};
    }

    [[nodiscard]] Trial refine(const RecurrenceSeed& seed, int period) const {
        const Eigen::Index n = section_.dimension();
        Eigen::MatrixXd start(n, period);
        for (int j = 0; j < period; ++j)
            start.col(j) =
                Eigen::Map<const Eigen::VectorXd>(section_.point(seed.start + static_cast<std::size_t>(j)), n);
        Trial trial;
        trial.draft.recurrences = seed.recurrences;
        for (const double enlargement : enlargements) {
            const RefinedCycle cycle = refine_cycle(section_, grid_, start, fit(enlargement));
            trial.accepted = cycle.status == RefinementStatus::converged && explains(cycle);
            if (!trial.accepted) continue;
            trial.draft.points = cycle.points;
            break;
        }
        return trial;
    }

    // Covariance, and whether the cycle can be believed. Where noise matters, wider neighbourhoods win.
    [[nodiscard]] Trial judge(const CycleDraft& draft) const {
        Trial best;
        for (const double enlargement : enlargements) {
            const Trial wider =
                judge(draft, refine_cycle(section_, grid_, draft.points, fit(enlargement)), enlargement);
            const bool better =
                wider.accepted && (!best.accepted || wider.draft.largest_sd() < worthwhile * best.draft.largest_sd());
            if (better) best = wider;
            if (!better && best.accepted) break;  // past the optimum: truncation takes over
        }
        return best;
    }

    [[nodiscard]] Trial judge(const CycleDraft& start, const RefinedCycle& cycle, double enlargement) const {
        Trial trial;
        trial.enlargement = enlargement;
        CycleDraft& draft = trial.draft;
        if (cycle.status != RefinementStatus::converged) return trial;
        const std::vector<RefinedCycle> refits{refit_cycle(section_, grid_, cycle.points, fit(0.5 * enlargement)),
                                               refit_cycle(section_, grid_, cycle.points, fit(2.0 * enlargement))};
        bool fits = explains(cycle);
        for (const RefinedCycle& refit : refits)
            fits = fits && refit.status == RefinementStatus::converged &&
                   cycle_distance(section_, cycle.points, refit.points, 0, false) <= largest_disagreement;
        if (!fits) return trial;
        const CycleUncertainty uncertainty = cycle_uncertainty(section_, cycle, refits);
        draft.points = cycle.points;
        draft.recurrences = start.recurrences;
        draft.covariance = uncertainty.covariance;
        draft.multipliers = uncertainty.multipliers;
        draft.ln_multiplier_covariance = uncertainty.ln_multiplier_covariance;
        draft.advance = count_turns(section_, grid_, draft.points);
        trial.accepted = draft.largest_sd() <= largest_sd && draft.multipliers.ln_modulus.size() > 0;
        remark(draft, cycle, refits, fit(enlargement));
        return trial;
    }

    void remark(CycleDraft& draft, const RefinedCycle& cycle, const std::vector<RefinedCycle>& refits,
                const FitChoice& choice) const {
        if (std::any_of(cycle.supports.begin(), cycle.supports.end(), [&](const Neighbourhood& support) {
                return support.offsets.rows() < static_cast<Eigen::Index>(choice.neighbours);
            }))
            draft.quality.emplace_back("images of a neighbourhood tear apart: fewer neighbours used");
        const Eigen::Index n = section_.dimension();
        const Eigen::VectorXd sd = draft.covariance.diagonal().cwiseSqrt();
        double disagreement = 0.0;  // of refits, largest over the coordinates, in sds
        for (const RefinedCycle& refit : refits)
            for (Eigen::Index j = 0; j < draft.points.cols(); ++j)
                disagreement = std::max(
                    disagreement,
                    section_.difference(Eigen::VectorXd(refit.points.col(j)), Eigen::VectorXd(cycle.points.col(j)))
                        .cwiseQuotient(sd.segment(j * n, n))
                        .cwiseAbs()
                        .maxCoeff());
        if (disagreement > remarkable)
            draft.quality.emplace_back("depends on the neighbourhoods' size beyond its error");
    }

    CycleSearchOptions options_;
    const SectionPoints& section_;
    BoxGrid grid_;
};

}  // namespace

std::unique_ptr<CycleFinder> local_map_finder(const SectionPoints& section, const CycleSearchOptions& options) {
    return std::make_unique<LocalMapFinder>(section, options);
}

}  // namespace orbid::orbits

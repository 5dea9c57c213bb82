#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <optional>
#include <string>
#include <utility>

#include <tbb/parallel_for.h>

#include "orbits/cycles/cycle_finder.hpp"
#include "orbits/cycles/cycle_refinement.hpp"
#include "orbits/cycles/recurrence.hpp"
#include "orbits/local_maps/cell_map.hpp"
#include "orbits/local_maps/fit_choice.hpp"
#include "orbits/local_maps/fit_limits.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_check.hpp"

namespace orbid::orbits {
namespace {

// A neighbourhood of which a fit, the point itself left out, explains less than 91 % of the variance is no map:
// shuffled points leave all of it, the clean pendulum less than 1e-6.
constexpr double fit_unexplained = 0.3;

// Standard deviation (scaled units) beyond which a cycle is not told from its neighbours (trials: 2e-3).
constexpr double largest_local_sd = 2e-3;

// Other fits of the same points may move a point by this much (scaled units; trials: 3e-3).
constexpr double largest_fit_disagreement = 3e-3;

// Edge of the cells (scaled units) that tell the itineraries of starts apart (trials: 1.2 %).
constexpr double itinerary_cell = 0.012;

// Two solutions are one before their sds are known when they lie within this distance (scaled units): starts of one
// cycle end within 1e-7 of each other on clean data.
constexpr double same_local_distance = 1e-6;

// Other fits that differ by more than this many standard deviations are remarked on.
constexpr double remarkable_fit_sds = 3.0;

// A cycle that fewer points of the series recur to is called isolated.
constexpr std::size_t few_recurrences = 3;

// ln|multiplier| nearer to zero than this many sds, or than this, is near-degenerate.
constexpr double degenerate_sds = 3.0;
constexpr double degenerate = 0.05;

// Leave-one-out predictions that leave more than this part of the images' spread at a point of a cycle are remarked on.
constexpr double weak = 0.1;

// Largest part of the images' spread that a point's fit leaves when the point itself is left out.
double unexplained_part(const RefinedCycle& cycle) {
    double largest = 0.0;
    for (const LocalMap& map : cycle.maps)
        largest = std::max(largest, map.left_out / map.image_spread);
    return largest;
}

// Starts that are closed before those that ended in one orbit are joined: a draft takes half a kilobyte.
constexpr std::size_t starts_at_once = 1 << 14;

// A number that does not depend on the point that comes first or on mirroring: what closed orbits are sorted by.
double fingerprint(const SectionPoints& section, const Eigen::MatrixXd& points) {
    double sum = 0.0;
    for (Eigen::Index j = 0; j < points.cols(); ++j)
        for (Eigen::Index d = 0; d < points.rows(); ++d) {
            const double x = points(d, j);
            const bool even = section.symmetric() && section.signs()[d] < 0.0;
            const double turn = 2.0 * std::numbers::pi * x;
            const double value =
                section.is_angle(d) ? std::cos(turn) + (even ? 0.0 : std::sin(turn)) : (even ? x * x : x);
            sum += static_cast<double>(d + 1) * value;
        }
    return sum;
}

// One draft for starts that ended in one orbit, the same to rounding: thousands of starts end in some hundred orbits.
// What this leaves apart, merged() joins.
std::vector<CycleCandidate> distinct(const SectionPoints& section, const std::vector<CycleCandidate>& drafts) {
    std::vector<std::pair<double, std::size_t>> order;
    for (std::size_t i = 0; i < drafts.size(); ++i)
        order.emplace_back(fingerprint(section, drafts[i].points), i);
    std::sort(order.begin(), order.end());
    std::vector<CycleCandidate> result;
    double last = 0.0;
    for (const auto& [number, i] : order) {
        if (!result.empty() && number - last < same_local_distance &&
            same_cycle(section, result.back().points, drafts[i].points, same_local_distance)) {
            result.back().recurrences += drafts[i].recurrences;
            continue;
        }
        last = number;
        result.push_back(drafts[i]);
    }
    return result;
}

// Starts that get fits of their own where cells fail. Measured on 2^20 sections of the pendulum: up to 0.15 ms of one
// core each, 1 to 18 ms per period on four; ten of them led to an orbit with 10 % boxes, seven with 40 %.
constexpr std::size_t direct_starts = 512;

class LocalMapFinder final : public CycleFinder {
public:
    LocalMapFinder(const SectionPoints& section, const CycleSearchOptions& options)
        : options_(checked(section, options)),
          section_(section),
          grid_(section),
          cells_(section, grid_, std::min(options.order, 2), static_cast<std::size_t>(options.neighbours)),
          choice_(section, grid_, options.order, static_cast<std::size_t>(options.neighbours)) {}

    [[nodiscard]] std::vector<CycleCandidate> find(int period, CycleSearch& search) const override {
        const std::vector<RecurrenceSeed> seeds = itinerary_seeds(section_, period, options_.box, itinerary_cell);
        search.candidates += seeds.size();
        std::vector<CycleCandidate> orbits;
        std::vector<std::size_t> lost;  // starts that do not close on cells
        // In blocks: wide boxes have a hundred times more starts than orbits.
        for (std::size_t first = 0; first < seeds.size(); first += starts_at_once) {
            std::vector<JudgedCandidate> closed(std::min(starts_at_once, seeds.size() - first));
            // Every index writes its own slot: the same bytes with any number of threads.
            tbb::parallel_for(std::size_t{0}, closed.size(),
                              [&](std::size_t i) { closed[i] = close(seeds[first + i], period); });
            for (std::size_t i = 0; i < closed.size(); ++i)
                if (!closed[i].accepted) lost.push_back(first + i);
            std::vector<CycleCandidate> some = accepted_drafts(std::move(closed), search);
            std::move(some.begin(), some.end(), std::back_inserter(orbits));
            orbits = distinct(section_, orbits);
        }
        // Starts that met other cells ended a little apart: one centred fit each brings them together.
        tbb::parallel_for(std::size_t{0}, orbits.size(), [&](std::size_t i) { (void)settle(orbits[i]); });
        for (CycleCandidate& draft : closed_directly(seeds, std::move(lost), period))
            orbits.push_back(std::move(draft));
        std::vector<CycleCandidate> drafts =
            merged(section_, distinct(section_, orbits), [](const auto&, const auto&) { return same_local_distance; });
        std::erase_if(drafts, [&](const CycleCandidate& draft) {
            return !is_prime(section_, draft.points, same_local_distance);
        });
        std::vector<JudgedCandidate> judged(drafts.size());
        tbb::parallel_for(std::size_t{0}, drafts.size(), [&](std::size_t i) { judged[i] = judge(drafts[i]); });
        drafts = merged_by_sds(section_, accepted_drafts(std::move(judged), search), merging_boxes * options_.box);
        std::erase_if(drafts, [&](const CycleCandidate& draft) {
            return draft.recurrences < static_cast<std::size_t>(options_.minimum_recurrences);
        });
        return drafts;
    }

    [[nodiscard]] std::vector<std::optional<CycleCandidate>> polish(
        const std::vector<CycleCandidate>& starts) const override {
        std::vector<std::optional<CycleCandidate>> result(starts.size());
        tbb::parallel_for(std::size_t{0}, starts.size(), [&](std::size_t i) {
            JudgedCandidate trial = judge(starts[i]);
            if (trial.accepted) result[i] = std::move(trial.draft);
        });
        return result;
    }

private:
    static CycleSearchOptions checked(const SectionPoints& section, const CycleSearchOptions& options) {
        check_neighbours(section.image_count(), options.neighbours, default_neighbours,
                         coefficient_count(section.dimension(), std::max(options.order, 1)) + 2);
        return options;
    }

    [[nodiscard]] JudgedCandidate close(const RecurrenceSeed& seed, int period) const {
        section_.stop_if_asked();
        JudgedCandidate trial;
        trial.draft = start_of(seed, period);
        trial.accepted = close_on_cells(section_, cells_, trial.draft.points);
        return trial;
    }

    [[nodiscard]] bool settle(CycleCandidate& draft) const {
        const RefinedCycle cycle =
            refine_cycle(section_, choice_, draft.points, FitSize{cells_.order(), cells_.neighbours()});
        if (cycle.converged) draft.points = cycle.points;
        return cycle.converged && unexplained_part(cycle) <= fit_unexplained;
    }

    // Where the map bends within a cell (next to the fold of a Lorenz section) only fits centred on the points close an
    // orbit. Wide boxes lose 1e5 starts, most of which lead nowhere: those with most recurrences alone get them.
    [[nodiscard]] std::vector<CycleCandidate> closed_directly(const std::vector<RecurrenceSeed>& seeds,
                                                              std::vector<std::size_t> lost, int period) const {
        const auto more = [&](std::size_t a, std::size_t b) {
            return seeds[a].recurrences != seeds[b].recurrences ? seeds[a].recurrences > seeds[b].recurrences : a < b;
        };
        const std::size_t count = std::min(direct_starts, lost.size());
        std::partial_sort(lost.begin(), lost.begin() + static_cast<std::ptrdiff_t>(count), lost.end(), more);
        std::vector<JudgedCandidate> trials(count);
        tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
            trials[i].draft = start_of(seeds[lost[i]], period);
            trials[i].accepted = settle(trials[i].draft);
        });
        std::vector<CycleCandidate> drafts;
        for (JudgedCandidate& trial : trials)
            if (trial.accepted) drafts.push_back(std::move(trial.draft));
        return drafts;
    }

    [[nodiscard]] CycleCandidate start_of(const RecurrenceSeed& seed, int period) const {
        CycleCandidate draft;
        draft.recurrences = seed.recurrences;
        draft.points = seed_points(section_, seed, period);
        return draft;
    }

    // The best fits that the data allow, covariance, and whether the cycle can be believed.
    [[nodiscard]] JudgedCandidate judge(const CycleCandidate& start) const {
        JudgedCandidate trial;
        const RefinedCycle cycle = refine_cycle(section_, choice_, start.points);
        if (!cycle.converged || !(unexplained_part(cycle) <= fit_unexplained)) return trial;
        std::vector<PlacedFits> fits;
        for (std::size_t j = 0; j < cycle.maps.size(); ++j)
            fits.push_back(choice_.fitted(cycle.points.col(static_cast<Eigen::Index>(j)), cycle.sizes[j]));
        const std::vector<RefinedCycle> refits{alternative_cycle(section_, cycle, fits, 1),
                                               alternative_cycle(section_, cycle, fits, 2)};
        for (const RefinedCycle& refit : refits)
            if (!(refit.converged &&
                  cycle_distance(section_, cycle.points, refit.points, 0, false) <= largest_fit_disagreement))
                return trial;
        const CycleUncertainty uncertainty = cycle_uncertainty(section_, cycle, fits, refits);
        CycleCandidate& draft = trial.draft;
        draft.points = cycle.points;
        draft.recurrences = start.recurrences;
        draft.covariance = uncertainty.covariance;
        draft.multipliers = uncertainty.multipliers;
        draft.ln_multiplier_covariance = uncertainty.ln_multiplier_covariance;
        draft.advance = count_turns(section_, grid_, draft.points);
        trial.accepted = draft.largest_sd() <= largest_local_sd && draft.multipliers.ln_modulus.size() > 0;
        remark(draft, cycle, uncertainty.disagreement);
        return trial;
    }

    void remark(CycleCandidate& draft, const RefinedCycle& cycle, double disagreement) const {
        const Eigen::Index n = section_.dimension();
        if (disagreement > remarkable_fit_sds)
            draft.quality.emplace_back("depends on the neighbourhoods' size beyond its error");
        if (draft.recurrences < few_recurrences)
            draft.quality.emplace_back("isolated: fewer than " + std::to_string(few_recurrences) +
                                       " points of the series recur to it");
        for (Eigen::Index a = 0; a < n; ++a)
            if (std::abs(draft.multipliers.ln_modulus[a]) <
                std::max(degenerate, degenerate_sds * std::sqrt(draft.ln_multiplier_covariance(a, a)))) {
                draft.quality.emplace_back("near-degenerate: a multiplier is near the unit circle");
                break;
            }
        if (unexplained_part(cycle) > weak)
            draft.quality.emplace_back("possibly spurious: the map explains little of the images at one of its points");
    }

    CycleSearchOptions options_;
    const SectionPoints& section_;
    NeighbourIndex grid_;
    CellMap cells_;
    FitChoice choice_;
};

}  // namespace

std::unique_ptr<CycleFinder> local_map_finder(const SectionPoints& section, const CycleSearchOptions& options) {
    return std::make_unique<LocalMapFinder>(section, options);
}

}  // namespace orbid::orbits

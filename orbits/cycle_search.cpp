#include "orbits/cycle_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "orbits/box_grid.hpp"
#include "orbits/cycle_refinement.hpp"
#include "orbits/recurrence.hpp"
#include "orbits/section_points.hpp"

namespace orbid::orbits {

namespace {

// A neighbourhood of which the fit explains less than 99 % of the variance is no map: shuffled points leave about
// 80 %, the clean pendulum less than 1e-4.
constexpr double unexplained = 0.3;

// Standard deviation (scaled units) beyond which a cycle is not told from its neighbours (trials: 2e-3).
constexpr double largest_sd = 2e-3;

// Refits with other neighbourhoods may move a point by this much (scaled units; trials: 3e-3).
constexpr double largest_disagreement = 3e-3;

// Two solutions are one cycle when all points lie within this many standard deviations, or, before these are known,
// within this distance (scaled units): seeds of one cycle end within 1e-7 of each other on clean data.
constexpr double same_sds = 6.0;
constexpr double same_distance = 1e-6;

// ... but never farther apart than this part of a box.
constexpr double same_boxes = 0.3;

// Refits that differ by more than this many standard deviations are remarked on.
constexpr double remarkable = 3.0;

// Noise blurs a small neighbourhood: fits of this many times the asked neighbours are tried as well.
constexpr std::array<double, 4> enlargements{1.0, 4.0, 16.0, 64.0};

// A larger neighbourhood must bring the largest standard deviation down to this part to be preferred: a smaller gain
// may be luck, and choosing the luckiest estimate makes it too small.
constexpr double worthwhile = 0.5;

struct Draft {
    Eigen::MatrixXd points;  // shape (n, p), scaled
    std::size_t recurrences = 0;
    bool accepted = false;
    bool torn = false;
    double disagreement = 0.0;  // of refits, largest over the coordinates, in sds
    CycleUncertainty uncertainty;
    double largest_sd = 0.0;
    double enlargement = 1.0;  // of the neighbourhoods
    Eigen::VectorXd advance;   // turns per cycle and angle coordinate, when known
};

void validate(const CycleSearchOptions& options) {
    if (options.periods.empty()) throw std::invalid_argument("find_cycles: periods must not be empty");
    for (const int period : options.periods)
        if (!(period >= 1 && period <= 64))
            throw std::invalid_argument("find_cycles: periods must be in [1, 64], got " + std::to_string(period));
    if (!(options.box > 0.0 && options.box < 0.5))
        throw std::invalid_argument("find_cycles: box must be in (0, 0.5), got " + std::to_string(options.box));
    if (!(options.order == 1 || options.order == 2))
        throw std::invalid_argument("find_cycles: order must be 1 or 2, got " + std::to_string(options.order));
    if (!(options.minimum_recurrences >= 1))
        throw std::invalid_argument("find_cycles: minimum_recurrences must be at least 1, got " +
                                    std::to_string(options.minimum_recurrences));
}

void validate(const CycleSearchOptions& options, const SectionPoints& section) {
    const Eigen::Index least = coefficient_count(section.dimension(), options.order) + 2;
    if (!(options.neighbours >= least))
        throw std::invalid_argument("find_cycles: neighbours must be at least " + std::to_string(least) +
                                    " for this order and dimension, got " + std::to_string(options.neighbours));
    const std::size_t points = 10 * static_cast<std::size_t>(options.neighbours);
    if (!(section.image_count() >= points))
        throw std::invalid_argument("find_cycles: needs at least 10 x neighbours = " + std::to_string(points) +
                                    " points with an image, got " + std::to_string(section.image_count()));
}

// Largest coordinate of a(j) - b(j + shift) over all j, b mirrored or not.
double distance(const SectionPoints& section, const Eigen::MatrixXd& a, const Eigen::MatrixXd& b, Eigen::Index shift,
                bool mirrored) {
    const Eigen::Index p = a.cols();
    double largest = 0.0;
    for (Eigen::Index j = 0; j < p; ++j)
        for (Eigen::Index d = 0; d < a.rows(); ++d) {
            const double other = b(d, (j + shift) % p);
            largest = std::max(largest,
                               std::abs(section.difference(a(d, j), mirrored ? section.signs()[d] * other : other, d)));
        }
    return largest;
}

bool same_cycle(const SectionPoints& section, const Eigen::MatrixXd& a, const Eigen::MatrixXd& b, double tolerance) {
    for (Eigen::Index shift = 0; shift < a.cols(); ++shift) {
        if (distance(section, a, b, shift, false) <= tolerance) return true;
        if (section.symmetric() && distance(section, a, b, shift, true) <= tolerance) return true;
    }
    return false;
}

bool prime(const SectionPoints& section, const Eigen::MatrixXd& points, double tolerance) {
    for (Eigen::Index shift = 1; shift < points.cols(); ++shift)
        if (points.cols() % shift == 0 && distance(section, points, points, shift, false) <= tolerance) return false;
    return true;
}

bool explains(const RefinedCycle& cycle) {
    return std::all_of(cycle.maps.begin(), cycle.maps.end(),
                       [](const LocalMap& map) { return map.residual <= unexplained * map.image_spread; });
}

double tolerance(double sd_a, double sd_b, double box) {
    return std::min(same_boxes * box, std::max(same_distance, same_sds * std::hypot(sd_a, sd_b)));
}

class Search {
public:
    Search(const Series& series, const CycleSearchOptions& options)
        : options_(options), section_(series, options.symmetry_signs), grid_(section_) {}

    [[nodiscard]] const SectionPoints& section() const { return section_; }

    std::vector<Draft> drafts_of(int period, CycleSearch& result) const {
        const std::vector<RecurrenceSeed> seeds =
            recurrence_seeds(section_, period, options_.box, static_cast<std::size_t>(options_.minimum_recurrences));
        result.candidates += seeds.size();
        std::vector<Draft> refined(seeds.size());
        each(seeds.size(), [&](std::size_t i) { refined[i] = refine(seeds[i], period); });
        result.rejected += static_cast<std::size_t>(
            std::count_if(refined.begin(), refined.end(), [](const Draft& draft) { return !draft.accepted; }));

        std::vector<Draft> drafts = merged(refined, [&](const Draft&, const Draft&) { return same_distance; });
        std::erase_if(drafts, [&](const Draft& draft) { return !prime(section_, draft.points, same_distance); });
        each(drafts.size(), [&](std::size_t i) { judge(drafts[i]); });
        result.rejected += static_cast<std::size_t>(
            std::count_if(drafts.begin(), drafts.end(), [](const Draft& draft) { return !draft.accepted; }));
        drafts = merged(drafts, [&](const Draft& a, const Draft& b) {
            return tolerance(a.largest_sd, b.largest_sd, options_.box);
        });
        std::erase_if(drafts, [&](const Draft& draft) {
            return !prime(section_, draft.points, tolerance(draft.largest_sd, draft.largest_sd, options_.box));
        });
        std::stable_sort(drafts.begin(), drafts.end(),
                         [](const Draft& a, const Draft& b) { return a.recurrences > b.recurrences; });
        return drafts;
    }

    /// Appends a draft and, with a symmetry, its partner.
    void publish(const Draft& draft, std::vector<Cycle>& cycles) const {
        Cycle cycle = plain(draft);
        if (!section_.symmetric()) {
            cycles.push_back(std::move(cycle));
            return;
        }
        const Eigen::Index p = draft.points.cols();
        const double near = tolerance(draft.largest_sd, draft.largest_sd, options_.box);
        const std::size_t own = cycles.size();
        for (Eigen::Index shift = 0; shift < p; ++shift) {
            if (!(distance(section_, draft.points, draft.points, shift, true) <= near)) continue;
            Draft symmetric = draft;
            for (Eigen::Index j = 0; j < p; ++j) {
                const Eigen::VectorXd here = draft.points.col(j);
                const Eigen::VectorXd mirrored = section_.signs().cwiseProduct(draft.points.col((j + shift) % p));
                symmetric.points.col(j) = section_.wrapped(here + 0.5 * section_.difference(mirrored, here));
            }
            // Both halves come from the same data: twice the variance, so that together they say what one says.
            symmetric.uncertainty.covariance *= 2.0;
            cycle = plain(symmetric);
            cycle.mirror = own;
            cycles.push_back(std::move(cycle));
            return;
        }
        Draft partner = draft;
        for (Eigen::Index j = 0; j < p; ++j)
            partner.points.col(j) = section_.wrapped(section_.signs().cwiseProduct(draft.points.col(j)));
        const Eigen::VectorXd signs = section_.signs().replicate(p, 1);
        partner.uncertainty.covariance = signs.asDiagonal() * draft.uncertainty.covariance * signs.asDiagonal();
        for (Eigen::Index a = 0, d = 0; d < section_.dimension(); ++d)
            if (section_.angle()[static_cast<std::size_t>(d)]) {
                if (a < partner.advance.size()) partner.advance[a] *= section_.signs()[d];
                ++a;
            }
        Cycle mirror = plain(partner);
        cycle.mirror = own + 1;
        mirror.mirror = own;
        cycles.push_back(std::move(cycle));
        cycles.push_back(std::move(mirror));
    }

private:
    template <class Body>
    static void each(std::size_t count, const Body& body) {
        // Every index writes its own slot: the same bytes with any number of threads.
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count), [&](const tbb::blocked_range<std::size_t>& range) {
            for (std::size_t i = range.begin(); i < range.end(); ++i)
                body(i);
        });
    }

    [[nodiscard]] FitChoice fit(double factor) const {
        const auto least = static_cast<double>(coefficient_count(section_.dimension(), options_.order) + 2);
        return {options_.order, static_cast<std::size_t>(
                                    std::max(least, std::ceil(factor * static_cast<double>(options_.neighbours))))};
    }

    [[nodiscard]] Draft refine(const RecurrenceSeed& seed, int period) const {
        const Eigen::Index n = section_.dimension();
        Eigen::MatrixXd start(n, period);
        for (int j = 0; j < period; ++j)
            start.col(j) =
                Eigen::Map<const Eigen::VectorXd>(section_.point(seed.start + static_cast<std::size_t>(j)), n);
        Draft draft;
        draft.recurrences = seed.recurrences;
        for (const double enlargement : enlargements) {
            const RefinedCycle cycle = refine_cycle(section_, grid_, start, fit(enlargement));
            draft.accepted = cycle.status == RefinementStatus::converged && explains(cycle);
            if (!draft.accepted) continue;
            draft.points = cycle.points;
            draft.enlargement = enlargement;
            break;
        }
        return draft;
    }

    // Covariance, and whether the cycle can be believed. Where noise matters, wider neighbourhoods win.
    void judge(Draft& draft) const {
        const double first = draft.enlargement;
        Draft best = draft;
        judge(best, refit_cycle(section_, grid_, draft.points, fit(first)));
        for (const double enlargement : enlargements) {
            if (!(enlargement > first)) continue;
            Draft wider = draft;
            wider.enlargement = enlargement;
            judge(wider, refine_cycle(section_, grid_, draft.points, fit(enlargement)));
            const bool better = wider.accepted && (!best.accepted || wider.largest_sd < worthwhile * best.largest_sd);
            if (better) best = std::move(wider);
            if (!better && best.accepted) break;  // past the optimum: truncation takes over
        }
        draft = std::move(best);
    }

    void judge(Draft& draft, const RefinedCycle& cycle) const {
        draft.accepted = false;
        if (cycle.status != RefinementStatus::converged) return;
        const std::vector<RefinedCycle> refits{
            refit_cycle(section_, grid_, cycle.points, fit(0.5 * draft.enlargement)),
            refit_cycle(section_, grid_, cycle.points, fit(2.0 * draft.enlargement))};
        draft.accepted = explains(cycle);
        for (const RefinedCycle& refit : refits)
            draft.accepted = draft.accepted && refit.status == RefinementStatus::converged &&
                             distance(section_, cycle.points, refit.points, 0, false) <= largest_disagreement;
        if (!draft.accepted) return;
        draft.points = cycle.points;
        draft.uncertainty = cycle_uncertainty(section_, cycle, refits);
        const Eigen::VectorXd sd = draft.uncertainty.covariance.diagonal().cwiseSqrt();
        draft.largest_sd = sd.maxCoeff();
        draft.accepted = draft.largest_sd <= largest_sd && draft.uncertainty.multipliers.ln_modulus.size() > 0;
        for (const RefinedCycle& refit : refits)
            for (Eigen::Index j = 0; j < draft.points.cols(); ++j)
                draft.disagreement = std::max(
                    draft.disagreement,
                    section_.difference(Eigen::VectorXd(refit.points.col(j)), Eigen::VectorXd(cycle.points.col(j)))
                        .cwiseQuotient(sd.segment(j * section_.dimension(), section_.dimension()))
                        .cwiseAbs()
                        .maxCoeff());
        for (const Neighbourhood& support : cycle.supports)
            if (support.offsets.rows() < static_cast<Eigen::Index>(fit(draft.enlargement).neighbours))
                draft.torn = true;
        count_turns(draft, cycle);
    }

    // Turns are those of the nearest neighbours, corrected to the cycle's own points.
    void count_turns(Draft& draft, const RefinedCycle& cycle) const {
        if (!section_.turns_known()) return;
        std::vector<double> turns;
        for (Eigen::Index d = 0; d < section_.dimension(); ++d) {
            if (!section_.angle()[static_cast<std::size_t>(d)]) continue;
            double sum = 0.0;
            for (Eigen::Index j = 0; j < draft.points.cols(); ++j) {
                const Neighbourhood& support = cycle.supports[static_cast<std::size_t>(j)];
                const Neighbour& nearest = support.members.front();
                const double sign = nearest.mirrored ? section_.signs()[d] : 1.0;
                const double start = sign * section_.point(nearest.index)[d];
                const double image = sign * section_.point(nearest.index + 1)[d];
                sum += sign * section_.advance(nearest.index, d) +
                       section_.difference(draft.points(d, (j + 1) % draft.points.cols()), image, d) -
                       section_.difference(draft.points(d, j), start, d);
            }
            turns.push_back(std::nearbyint(sum));
        }
        draft.advance = Eigen::Map<const Eigen::VectorXd>(turns.data(), static_cast<Eigen::Index>(turns.size()));
    }

    // One draft per cycle (and mirror pair), the first with most recurrences; recurrences add up.
    template <class Tolerance>
    std::vector<Draft> merged(std::vector<Draft> drafts, const Tolerance& tolerance_of) const {
        std::erase_if(drafts, [](const Draft& draft) { return !draft.accepted; });
        std::stable_sort(drafts.begin(), drafts.end(),
                         [](const Draft& a, const Draft& b) { return a.recurrences > b.recurrences; });
        std::vector<Draft> result;
        for (Draft& draft : drafts) {
            const auto found = std::find_if(result.begin(), result.end(), [&](const Draft& other) {
                return same_cycle(section_, other.points, draft.points, tolerance_of(other, draft));
            });
            if (found == result.end())
                result.push_back(std::move(draft));
            else
                found->recurrences += draft.recurrences;
        }
        return result;
    }

    [[nodiscard]] Cycle plain(const Draft& draft) const {
        const Eigen::Index n = draft.points.rows(), p = draft.points.cols();
        Cycle cycle;
        cycle.period = static_cast<int>(p);
        cycle.points = section_.scale().asDiagonal() * draft.points;
        for (Eigen::Index d = 0; d < n; ++d)
            if (section_.angle()[static_cast<std::size_t>(d)])
                for (Eigen::Index j = 0; j < p; ++j)
                    if (!(cycle.points(d, j) > -std::numbers::pi)) cycle.points(d, j) += 2.0 * std::numbers::pi;
        const Eigen::VectorXd unit = section_.scale().replicate(p, 1);
        cycle.covariance = unit.asDiagonal() * draft.uncertainty.covariance * unit.asDiagonal();
        cycle.multipliers = draft.uncertainty.multipliers.values;
        cycle.ln_multiplier = draft.uncertainty.multipliers.ln_modulus;
        cycle.ln_multiplier_covariance = draft.uncertainty.ln_multiplier_covariance;
        cycle.recurrences = draft.recurrences;
        for (Eigen::Index a = 0; a < draft.advance.size(); ++a)
            cycle.rotation.push_back(static_cast<int>(draft.advance[a]));
        if (draft.torn) cycle.quality.emplace_back("images of a neighbourhood tear apart: fewer neighbours used");
        if (draft.disagreement > remarkable)
            cycle.quality.emplace_back("depends on the neighbourhoods' size beyond its error");
        return cycle;
    }

    CycleSearchOptions options_;
    SectionPoints section_;
    BoxGrid grid_;
};

}  // namespace

CycleSearch find_cycles(const Series& series, const CycleSearchOptions& options) {
    validate(options);
    const Search search(series, options);
    validate(options, search.section());
    std::vector<int> periods = options.periods;
    std::sort(periods.begin(), periods.end());
    periods.erase(std::unique(periods.begin(), periods.end()), periods.end());
    CycleSearch result;
    for (const int period : periods) {
        const std::vector<Draft> drafts = search.drafts_of(period, result);
        if (drafts.empty()) result.missing.push_back(period);
        for (const Draft& draft : drafts)
            search.publish(draft, result.cycles);
    }
    return result;
}

}  // namespace orbid::orbits

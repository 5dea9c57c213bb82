#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include <tbb/parallel_for.h>

#include "orbits/box_grid.hpp"
#include "orbits/cycle_finder.hpp"
#include "orbits/patch_map_cycle.hpp"
#include "orbits/patch_map_fit.hpp"
#include "orbits/section_lift.hpp"

namespace orbid::orbits {

namespace {

// Largest standard deviation (scaled units) of a cycle that is told from its neighbours.
constexpr double largest_sd = 0.01;

// Newton solutions of one map from different starts end within this distance.
constexpr double same_distance = 1e-7;

// Starts per period at most, those that close best.
constexpr std::size_t maximum_starts = 20000;

class PatchMapFinder final : public CycleFinder {
public:
    PatchMapFinder(const SectionPoints& section, const CycleSearchOptions& options,
                   const Eigen::MatrixXd& reading_covariance)
        : options_(options), section_(section), fit_(fitted(section, reading_covariance)) {}

    [[nodiscard]] std::vector<CycleDraft> find(int period, CycleSearch& search) const override {
        search.patch_map = true;
        if (!fit_.usable) return {};
        const std::vector<std::size_t> starts = recurrent(period);
        search.candidates += starts.size();
        std::vector<PatchMapCycle> closed(starts.size());
        tbb::parallel_for(std::size_t{0}, starts.size(), [&](std::size_t i) {
            closed[i] = close_on_patch_map(section_, fit_.map,
                                           fit_.states.middleCols(static_cast<Eigen::Index>(starts[i]), period));
        });
        std::vector<CycleDraft> drafts;
        for (const PatchMapCycle& cycle : closed) {
            if (!cycle.converged || !is_prime(section_, cycle.points, 10.0 * same_distance)) {
                ++search.rejected;
                continue;
            }
            CycleDraft draft;
            draft.points = cycle.points;
            draft.recurrences = 1;
            drafts.push_back(std::move(draft));
        }
        drafts = merged(section_, std::move(drafts), [](const auto&, const auto&) { return same_distance; });
        tbb::parallel_for(std::size_t{0}, drafts.size(), [&](std::size_t i) {
            const std::size_t recurrences = drafts[i].recurrences;
            drafts[i] = draft_of(section_, fit_, {drafts[i].points, true});
            drafts[i].recurrences = recurrences;
            drafts[i].same_within = 10.0 * same_distance;
        });
        const std::size_t before = drafts.size();
        std::erase_if(drafts, [](const CycleDraft& draft) { return !(draft.largest_sd() <= largest_sd); });
        search.rejected += before - drafts.size();
        return drafts;
    }

private:
    static PatchMapFit fitted(const SectionPoints& section, const Eigen::MatrixXd& reading_covariance) {
        const BoxGrid grid(section);
        const SectionLift lift = lift_section(section, grid);
        PatchMapFitOptions options;
        options.spacing = 0.025;
        options.last_share = 0.1;
        return fit_patch_map(section, lift, reading_covariance, options);
    }

    // Pieces of the smoothed series that come back within a box, best first.
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
                if (gap <= options_.box) found.emplace_back(gap, i - p);
            }
            run = section_.has_image(i) ? run + 1 : 0;
        }
        std::sort(found.begin(), found.end());
        if (found.size() > maximum_starts) found.resize(maximum_starts);
        std::vector<std::size_t> starts;
        for (const auto& [gap, start] : found)
            starts.push_back(start);
        return starts;
    }

    CycleSearchOptions options_;
    const SectionPoints& section_;
    PatchMapFit fit_;
};

}  // namespace

std::unique_ptr<CycleFinder> patch_map_finder(const SectionPoints& section, const CycleSearchOptions& options,
                                              const Eigen::MatrixXd& reading_covariance_scaled) {
    return std::make_unique<PatchMapFinder>(section, options, reading_covariance_scaled);
}

}  // namespace orbid::orbits

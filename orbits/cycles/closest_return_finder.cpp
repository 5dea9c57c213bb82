#include <algorithm>
#include <utility>

#include <tbb/parallel_for.h>

#include "models/arithmetic/lu_factor.hpp"
#include "orbits/cycles/cycle_finder.hpp"
#include "orbits/cycles/cycle_refinement.hpp"
#include "orbits/cycles/recurrence.hpp"
#include "orbits/local_maps/reference_map.hpp"
#include "orbits/records/refusal.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_check.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// The paper's: neighbours out of two boxes around the reference, 32 of them or more.
constexpr double ball_boxes = 2.0;
constexpr int least_map_neighbours = 32;

// A linear map must explain half of the variance of its neighbours' images: of shuffled points two slopes explain
// 2 / 32, and half of it with a probability below 1e-7. Reading errors of half a box leave a map above this.
constexpr double linear_unexplained = 0.7;

// Two estimates of one cycle lie within six of their standard deviations, but never farther apart than this.
constexpr double same_cycle_boxes = 1.0;

// A cycle known less well than to half a box is not told from its neighbours.
constexpr double largest_sd_boxes = 0.5;

class ClosestReturnFinder final : public CycleFinder {
public:
    ClosestReturnFinder(const SectionPoints& section, const CycleSearchOptions& options)
        : options_(options), section_(section), grid_(section) {
        refuse_if(options_.order > 1, "find_cycles: closest_return fits linear maps, order must be 1 or 0, got {}",
                  options_.order);
        check_neighbours(section.image_count(), options_.neighbours, least_map_neighbours, section.dimension() + 2);
        if (options_.neighbours == 0) options_.neighbours = least_map_neighbours;
        const MatrixXd unit = section.scale().cwiseInverse().asDiagonal();
        if (options.reading_covariance.size() > 0) reading_covariance_ = unit * options.reading_covariance * unit;
    }

    [[nodiscard]] std::vector<CycleCandidate> find(int period, CycleSearch& search) const override {
        const std::vector<RecurrenceSeed> seeds =
            recurrence_seeds(section_, period, options_.box, static_cast<std::size_t>(options_.minimum_recurrences));
        search.candidates += seeds.size();
        std::vector<JudgedCandidate> trials(seeds.size());
        // Every start writes its own slot: the same bytes with any number of threads.
        tbb::parallel_for(std::size_t{0}, seeds.size(), [&](std::size_t i) { trials[i] = estimate(seeds[i], period); });
        return merged_by_sds(section_, accepted_drafts(std::move(trials), search), same_cycle_boxes * options_.box);
    }

private:
    [[nodiscard]] JudgedCandidate estimate(const RecurrenceSeed& seed, int period) const {
        const Index n = section_.dimension(), p = period;
        const double ball = ball_boxes * options_.box;
        std::vector<ReferenceMap> maps;
        std::vector<MatrixXd> jacobians;
        JudgedCandidate trial;
        for (Index j = 0; j < p; ++j) {
            maps.push_back(fit_reference_map(section_, grid_, seed.start + static_cast<std::size_t>(j), ball,
                                             static_cast<std::size_t>(options_.neighbours)));
            const ReferenceMap& map = maps.back();
            const auto least = static_cast<Index>(std::min(options_.neighbours, least_map_neighbours));
            if (!map.usable || map.offsets.rows() < least || !(map.residual <= linear_unexplained * map.image_spread))
                return trial;
            jacobians.push_back(map.jacobian);
        }
        // (P8) for all points together: A_j u_j - u_{j+1} = 0 with u_j = x_0j - x_{t+j}, and the gap of the return
        // where the piece closes. For u_0 that is (I - A^p) u_0 = x_{t+p} - x_t, without the product.
        const models::LuFactor coupled(coupled_matrix(jacobians));
        VectorXd gap = VectorXd::Zero(n * p);
        const auto place = [&](Index j) {
            return Eigen::Map<const VectorXd>(section_.point(seed.start + static_cast<std::size_t>(j)), n);
        };
        gap.tail(n) = -section_.difference(VectorXd(place(p)), VectorXd(place(0)));
        const VectorXd offset = coupled.solve(gap);
        // Where a map was fitted it may be used.
        if (!(offset.cwiseAbs().maxCoeff() <= ball)) return trial;
        CycleCandidate& draft = trial.draft;
        draft.recurrences = seed.recurrences;
        draft.points.resize(n, p);
        for (Index j = 0; j < p; ++j)
            draft.points.col(j) = section_.wrapped(place(j) + offset.segment(j * n, n));
        const ReferenceErrors errors = reference_errors(maps, offset, coupled.inverse(), reading_covariance_);
        draft.covariance = errors.covariance;
        draft.multipliers = errors.multipliers;
        draft.ln_multiplier_covariance = errors.ln_multiplier_covariance;
        if (section_.timed()) {
            draft.time = 0.0;
            for (Index j = 0; j < p; ++j) {
                const ReferenceMap& map = maps[static_cast<std::size_t>(j)];
                draft.time += map.return_time + map.time_slope.dot(offset.segment(j * n, n));
            }
            draft.time_sd = errors.time_sd;
        }
        draft.advance = count_turns(section_, grid_, draft.points);
        trial.accepted =
            draft.multipliers.ln_modulus.size() > 0 && draft.largest_sd() <= largest_sd_boxes * options_.box;
        return trial;
    }

    CycleSearchOptions options_;
    const SectionPoints& section_;
    NeighbourIndex grid_;
    MatrixXd reading_covariance_;  // scaled units; empty: from the residuals
};

}  // namespace

std::unique_ptr<CycleFinder> closest_return_finder(const SectionPoints& section, const CycleSearchOptions& options) {
    return std::make_unique<ClosestReturnFinder>(section, options);
}

}  // namespace orbid::orbits

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <tbb/parallel_for.h>

#include "models/arithmetic/cholesky_factor.hpp"
#include "models/arithmetic/lu_factor.hpp"
#include "orbits/cycles/cycle_finder.hpp"
#include "orbits/cycles/cycle_refinement.hpp"
#include "orbits/cycles/recurrence.hpp"
#include "orbits/cycles/shared_readings.hpp"
#include "orbits/local_maps/manifold_map.hpp"
#include "orbits/sections/neighbour_index.hpp"

namespace orbid::orbits {
namespace {

// Rounds in which the fits are renewed around the points; order and neighbours of the fits stay from the third on, so
// that the answer cannot jump between two choices.
constexpr int most_rounds = 12;
constexpr int free_rounds = 3;

// The points have settled when they move by less than this part of their own sd.
constexpr double settled = 0.02;

// Longest step of a coordinate of a point in one round (scaled units).
constexpr double step_limit = 0.05;

// What a fit explains must exceed what it leaves over so many times, per coefficient and point, at every point of a
// cycle: of fits to shuffled images (Lorenz, Roessler) 95 % stay below 4.3, 99 % of those that can be fitted below 8
// and 22; fits to true images have medians of 900 and 5700.
constexpr double significant = 10.0;

// A place with fewer of its neighbours on one side is extrapolated to: the sheet has ended, or another piece of the map
// begun.
constexpr double least_beside = 0.05;

// Standard deviation (scaled units) beyond which a cycle is not told from its neighbours: half of what still counts as
// a position.
constexpr double largest_manifold_sd = 1e-2;

// Cycles farther apart than this (scaled units) are two, whatever their sds.
constexpr double same_limit = 0.02;

struct Solution {
    Eigen::MatrixXd points;
    std::vector<ManifoldMap> maps;
    bool converged = false;
};

class ManifoldMapFinder final : public CycleFinder {
public:
    ManifoldMapFinder(const SectionPoints& section, const CycleSearchOptions& options,
                      const Eigen::MatrixXd& covariance)
        : options_(options), section_(section), grid_(section), fits_(section, grid_, root(covariance)) {}

    [[nodiscard]] std::vector<CycleCandidate> find(int period, CycleSearch& search) const override {
        const std::vector<RecurrenceSeed> seeds =
            recurrence_seeds(section_, period, options_.box, static_cast<std::size_t>(options_.minimum_recurrences));
        search.candidates += seeds.size();
        std::vector<JudgedCandidate> trials(seeds.size());
        std::vector<Solution> solutions(seeds.size());
        // Every index writes its own slot: the same bytes with any number of threads.
        tbb::parallel_for(std::size_t{0}, seeds.size(), [&](std::size_t i) {
            Solution solution = solve(seeds[i], period);
            if (!solution.converged) return;
            trials[i].draft = draft(solution);
            trials[i].draft.recurrences = seeds[i].recurrences;
            trials[i].draft.start = i;
            trials[i].accepted = believable(trials[i].draft, solution);
            solutions[i] = std::move(solution);
        });
        std::vector<CycleCandidate> cycles =
            merged_by_sds(section_, accepted_drafts(std::move(trials), search), same_limit);
        if (section_.errors_known())
            for (CycleCandidate& cycle : cycles)
                trace_errors(solutions[cycle.start].maps, cycle);
        return cycles;
    }

private:
    static Eigen::MatrixXd root(const Eigen::MatrixXd& covariance) {
        return models::CholeskyFactor(covariance).lower();
    }

    [[nodiscard]] Solution solve(const RecurrenceSeed& seed, int period) const {
        const Eigen::Index n = section_.dimension(), p = period;
        Solution solution;
        solution.points = seed_points(section_, seed, period);
        for (int round = 0; round < most_rounds; ++round) {
            std::vector<ManifoldMap> maps;
            std::vector<Eigen::MatrixXd> jacobians;
            for (Eigen::Index j = 0; j < p; ++j) {
                const auto at = static_cast<std::size_t>(j);
                const Eigen::VectorXd place = solution.points.col(j);
                ManifoldMap map;
                if (round >= free_rounds) {
                    map = fits_.fit(place, solution.maps[at].order, solution.maps[at].neighbours);
                    // The scatter between choices of the fit is known from the last free round.
                    if (map.sheet_dimension() == solution.maps[at].sheet_dimension()) {
                        map.covariance = solution.maps[at].covariance;
                        map.choice = solution.maps[at].choice;
                    }
                }
                if (!map.usable) map = fits_.best(place);
                if (!map.usable) return solution;
                jacobians.push_back(map.jacobian());
                maps.push_back(std::move(map));
            }
            Eigen::VectorXd defect(n * p);
            for (Eigen::Index j = 0; j < p; ++j)
                defect.segment(j * n, n) = section_.difference(maps[static_cast<std::size_t>(j)].value,
                                                               Eigen::VectorXd(solution.points.col((j + 1) % p)));
            const Eigen::VectorXd step = -models::LuFactor(coupled_matrix(jacobians)).solve(defect);
            if (!step.allFinite()) return solution;
            const double largest = step.cwiseAbs().maxCoeff();
            const double share = std::min(1.0, step_limit / largest);
            for (Eigen::Index j = 0; j < p; ++j)
                solution.points.col(j) = section_.wrapped(solution.points.col(j) + share * step.segment(j * n, n));
            solution.maps = std::move(maps);
            const double sd = std::sqrt(point_covariance(solution.maps).diagonal().maxCoeff());
            if (round >= free_rounds && largest <= settled * sd) {
                solution.converged = true;
                return solution;
            }
        }
        return solution;
    }

    // Points and time by the errors of values and times of all fits: rows are the points' coordinates, then T.
    [[nodiscard]] Eigen::MatrixXd response_of(const std::vector<ManifoldMap>& maps) const {
        const Eigen::Index n = section_.dimension(), p = static_cast<Eigen::Index>(maps.size());
        std::vector<Eigen::MatrixXd> jacobians;
        Eigen::RowVectorXd time_slope(n * p);
        for (Eigen::Index j = 0; j < p; ++j) {
            const ManifoldMap& map = maps[static_cast<std::size_t>(j)];
            jacobians.push_back(map.jacobian());
            time_slope.segment(j * n, n) = map.time_slope.transpose() * map.along;
        }
        const Eigen::MatrixXd inverse = models::inverse(coupled_matrix(jacobians));
        Eigen::MatrixXd response = Eigen::MatrixXd::Zero(n * p + 1, (n + 1) * p);
        for (Eigen::Index j = 0; j < p; ++j) {
            response.block(0, j * (n + 1), n * p, n) = -inverse.middleCols(j * n, n);
            response.block(n * p, j * (n + 1), 1, n) = -time_slope * inverse.middleCols(j * n, n);
            response(n * p, j * (n + 1) + n) = 1.0;
        }
        return response;
    }

    // Their covariance, with fits that are independent.
    [[nodiscard]] Eigen::MatrixXd point_covariance(const std::vector<ManifoldMap>& maps) const {
        const Eigen::Index n = section_.dimension(), p = static_cast<Eigen::Index>(maps.size());
        Eigen::MatrixXd errors = Eigen::MatrixXd::Zero((n + 1) * p, (n + 1) * p);
        for (Eigen::Index j = 0; j < p; ++j)
            errors.block(j * (n + 1), j * (n + 1), n + 1, n + 1) = maps[static_cast<std::size_t>(j)].covariance;
        const Eigen::MatrixXd response = response_of(maps);
        return response * errors * response.transpose();
    }

    // The covariance as the errors of the section's points make it, which several fits and cycles share. What the
    // choice of the fits adds is the cycle's own.
    void trace_errors(const std::vector<ManifoldMap>& maps, CycleCandidate& cycle) const {
        const Eigen::Index n = section_.dimension(), p = static_cast<Eigen::Index>(maps.size());
        const Eigen::MatrixXd response = response_of(maps);
        Eigen::MatrixXd choices = Eigen::MatrixXd::Zero((n + 1) * p, p);
        for (Eigen::Index j = 0; j < p; ++j)
            if (const ManifoldMap& map = maps[static_cast<std::size_t>(j)]; map.choice.size() > 0)
                choices.block(j * (n + 1), j, n + 1, 1) = map.choice;
        const Eigen::MatrixXd own = response * choices;
        const Eigen::Index k = cycle.multipliers.ln_modulus.size();
        Eigen::MatrixXd with_multipliers = Eigen::MatrixXd::Zero(n * p + k + 1, response.cols());
        with_multipliers.topRows(n * p) = response.topRows(n * p);
        with_multipliers.bottomRows(1) = response.bottomRows(1);
        cycle.readings = errors_by_readings(section_, maps, with_multipliers);
        const Eigen::MatrixXd all = cycle.readings.shares.transpose() * cycle.readings.shares;
        Eigen::MatrixXd covariance = own * own.transpose();
        covariance.topLeftCorner(n * p, n * p) += all.topLeftCorner(n * p, n * p);
        covariance.topRightCorner(n * p, 1) += all.topRightCorner(n * p, 1);
        covariance(n * p, n * p) += all(all.rows() - 1, all.cols() - 1);
        set_errors(covariance, cycle);
    }

    void set_errors(const Eigen::MatrixXd& covariance, CycleCandidate& cycle) const {
        const Eigen::Index coordinates = cycle.points.size();
        cycle.covariance = covariance.topLeftCorner(coordinates, coordinates);
        // Along the sheet there are fewer directions than coordinates, so the matrix is singular; what the readings
        // leave uncertain across the sheet is at least a small part of its largest variance.
        cycle.covariance.diagonal().array() += least_share * cycle.covariance.diagonal().maxCoeff();
        if (!section_.timed()) return;
        cycle.time_covariance = covariance.topRightCorner(coordinates, 1);
        cycle.time_sd = std::sqrt((1.0 + least_share) * covariance(coordinates, coordinates));
    }

    [[nodiscard]] CycleCandidate draft(const Solution& solution) const {
        CycleCandidate result;
        result.points = solution.points;
        set_errors(point_covariance(solution.maps), result);
        if (section_.timed()) {
            result.time = 0.0;
            for (const ManifoldMap& map : solution.maps)
                result.time += map.time;
        }
        multipliers(solution, result);
        result.advance = count_turns(section_, grid_, result.points);
        return result;
    }

    // Those along the sheet; the jacobians have no more rank than the sheet has dimensions at its thinnest.
    void multipliers(const Solution& solution, CycleCandidate& result) const {
        const Eigen::Index n = section_.dimension();
        Eigen::Index k = n;
        std::vector<Eigen::MatrixXd> steps;
        for (const ManifoldMap& map : solution.maps) {
            k = std::min(k, map.sheet_dimension());
            steps.push_back(map.jacobian());
        }
        result.multipliers = leading(cycle_multipliers(steps), k);
        result.ln_multiplier_covariance = Eigen::MatrixXd::Zero(k, k);
        for (std::size_t j = 0; j < steps.size(); ++j) {
            const ManifoldMap& map = solution.maps[j];
            for (Eigen::Index a = 0; a < n; ++a)
                for (Eigen::Index b = 0; b < map.sheet_dimension(); ++b) {
                    const double sd = std::sqrt(map.image_covariance(a, a) * map.slope_leverage[b]);
                    const Eigen::MatrixXd kept = steps[j];
                    steps[j].row(a) += sd * map.along.row(b);
                    const Eigen::VectorXd up = leading(cycle_multipliers(steps), k).ln_modulus;
                    steps[j].row(a) -= 2.0 * sd * map.along.row(b);
                    const Eigen::VectorXd down = leading(cycle_multipliers(steps), k).ln_modulus;
                    steps[j] = kept;
                    const Eigen::VectorXd change = 0.5 * (up - down);
                    if (change.allFinite()) result.ln_multiplier_covariance += change * change.transpose();
                }
        }
        result.ln_multiplier_covariance.diagonal().array() += std::numeric_limits<double>::epsilon();
        result.quality.push_back("the section is a sheet of " + std::to_string(k) +
                                 (k == 1 ? " dimension" : " dimensions") +
                                 " within the errors of its readings: multipliers across it are not told");
    }

    static CycleMultipliers leading(CycleMultipliers all, Eigen::Index k) {
        all.values.resize(static_cast<std::size_t>(k));
        all.ln_modulus.conservativeResize(k);
        return all;
    }

    [[nodiscard]] static bool believable(const CycleCandidate& one, const Solution& solution) {
        return one.largest_sd() <= largest_manifold_sd && one.multipliers.ln_modulus.allFinite() &&
               std::all_of(solution.maps.begin(), solution.maps.end(), [](const ManifoldMap& map) {
                   return map.significance >= significant && map.beside >= least_beside;
               });
    }

    static constexpr double least_share = 1e-6;

    CycleSearchOptions options_;
    const SectionPoints& section_;
    NeighbourIndex grid_;
    ManifoldMapFits fits_;
};

}  // namespace

std::unique_ptr<CycleFinder> sheet_map_finder(const SectionPoints& section, const CycleSearchOptions& options,
                                              const Eigen::MatrixXd& reading_covariance) {
    return std::make_unique<ManifoldMapFinder>(section, options, reading_covariance);
}

}  // namespace orbid::orbits

#include "periodic/search/start_search.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include <tbb/parallel_for.h>

#include "models/arithmetic/splitmix64.hpp"
#include "periodic/orbit/coarse_flow.hpp"
#include "periodic/orbit/winding_number.hpp"
#include "periodic/search/index_sum.hpp"
#include "periodic/search/pseudo_orbit_start.hpp"
#include "periodic/search/recurrence_start.hpp"
#include "periodic/search/section_cell.hpp"
#include "periodic/search/symbolic_start.hpp"
#include "periodic/solution/multiple_shooting.hpp"

namespace orbid::periodic {
namespace {

/// Starts that are solved before the list is looked at again: the result depends on it, not on the number of threads.
constexpr std::size_t batch = 256;

/// Accuracy of closing a start.
constexpr double coarse_closing = 1e-6;

/// Edge of the cells that distinguish itineraries of recurrences, relative to the section.
constexpr double recurrence_cell = 0.05;

/// Edges of the cells through which pieces are joined, relative to the section. Pendulum, g = 9.81, 2^17 points: any
/// edge from 1/24 to 1/4 gives all 352 orbits of period 5 in one round; 1/32 gives 344, 1/48 298. With 2^15 points
/// edges work from 1/8 on, with 2^19 from 1/48 on. So the first edge goes with the root of the points.
constexpr double edge_at_2_17 = 1.0 / 24.0;
constexpr double finest_first_edge = 1.0 / 64.0;
constexpr double coarsest_edge = 1.0 / 8.0 + 1e-9;
constexpr double finest_edge = 1e-3;
constexpr double edge_ratio = 1.4142135623730951;

/// Starts from one loop of cells where strong stretching leads several orbits through the same cells.
constexpr std::size_t variants = 8;
constexpr double variants_edge = 1.0 / 16.0;

/// Random states that are tried for every period.
constexpr std::size_t scattered_states = 64;

std::vector<double> section_signs(const ModelSection& section) {
    const auto symmetry = section.system.symmetry();
    if (!symmetry || symmetry->phase_shift != 0.0) return {};
    if (section.section) {
        const VectorXd& normal = section.section->normal;
        for (Index i = 0; i < normal.size(); ++i)
            if (normal(i) != 0.0 && symmetry->signs[static_cast<std::size_t>(i)] != 1.0) return {};
    }
    return symmetry->signs;
}

}  // namespace

StartSearch::StartSearch(const ModelSection& section, const OrbitSearchOptions& options, const SectionPieces& pieces)
    : section_(section),
      options_(options),
      pieces_(pieces),
      list_(section, pieces.size, options.solver),
      coarse_(options.solver),
      chart_(section, pieces.size) {
    coarse_.scale = pieces.size;
    coarse_.maximum_distance = std::numeric_limits<double>::infinity();
    coarse_.tolerance = std::max(options.solver.tolerance, coarse_closing);
    coarse_.flow = coarsened(options.solver.flow, search_tolerance);
    coarse_.nearest = false;  // any orbit is welcome: what looking for the nearest one costs goes into more starts
    // A start whose steps have to be shortened more than that rarely ends at an orbit. 3.4 s instead of 5.2 s for the
    // pendulum's periods 1 to 4, the same orbits.
    coarse_.minimum_damping = std::max(options.solver.minimum_damping, 0.1);
    if (options.symmetry) signs_ = section_signs(section);
}

void StartSearch::solve(std::size_t count, StartOrigin origin, std::size_t patience,
                        const std::function<MatrixXd(std::size_t)>& start_at) {
    std::size_t idle = 0;
    for (std::size_t done = 0; done < count && !stopped(); done += batch) {
        const std::size_t size = std::min(batch, count - done);
        std::vector<MatrixXd> closed(size);
        tbb::parallel_for(std::size_t{0}, size, [&](std::size_t k) {
            const StartingSolution start = section_.start(start_at(done + k));
            if (start.points.cols() == 0) return;
            const PeriodicOrbit orbit = solve_multiple_shooting(section_.system, section_.theta, start, {}, coarse_);
            if (orbit.status == OrbitStatus::converged || orbit.status == OrbitStatus::shorter_period)
                closed[k] = orbit.points;
        });
        starts_ += size;
        for (const MatrixXd& points : closed) {
            ++idle;
            if (points.cols() > 0 && list_.add(points, origin, options_.symmetry)) idle = 0;
        }
        if (options_.progress) options_.progress(starts_, list_.orbits().size());
        if (idle >= patience && 4 * idle >= done + size) return;
    }
}

void StartSearch::from_codes() {
    if (options_.codes.empty()) return;
    const SymbolicStarts symbolic(section_, pieces_, *options_.partition);
    for (const std::string& word : options_.codes) {
        const CodedOrbit coded = symbolic.solve(word, coarse_);
        if (coded.found) list_.add(coded.orbit.points, StartOrigin::code, options_.symmetry);
        ++starts_;
    }
}

void StartSearch::from_recurrences(int period) {
    const auto starts = recurrence_starts(section_.system, pieces_, period, options_.widest, recurrence_cell, signs_);
    solve(starts.size(), StartOrigin::recurrence, options_.patience,
          [&](std::size_t k) { return starts[k].points(pieces_, period); });
}

void StartSearch::from_scattered(int period) {
    const VectorXd middle = pieces_.lowest + 0.5 * pieces_.size;
    solve(scattered_states, StartOrigin::scattered, options_.patience, [&](std::size_t k) {
        const VectorXd x = on_section(middle + random_state(pieces_.size, options_.seed, k));
        return chart_.returned(x, period, coarse_.flow).points;
    });
}

double StartSearch::first_edge(int period) const {
    double edge = std::clamp(edge_at_2_17 * std::sqrt(0x1p17 / static_cast<double>(options_.points)), finest_first_edge,
                             coarsest_edge / edge_ratio);
    while (edge > finest_edge && !loops_of(period, edge, 0))
        edge /= edge_ratio;
    return edge;
}

bool StartSearch::from_joined(int period) {
    bool in_vain = false, first = true;
    for (double edge = first_edge(period); edge <= coarsest_edge && !stopped(); edge *= edge_ratio) {
        const auto loops = loops_of(period, edge, 1);
        if (!loops) break;
        const std::size_t before = list_.orbits().size();
        solve(loops->size(), StartOrigin::joined, options_.patience, [&](std::size_t k) { return (*loops)[k]; });
        in_vain = list_.orbits().size() == before;
        // The finest cells may have next to no loops: they do not decide alone.
        if (in_vain && !first) break;
        first = false;
    }
    return in_vain && !stopped();
}

bool StartSearch::indices_agree(int period) const {
    std::vector<PeriodicOrbit> orbits;
    for (const FoundOrbit& found : list_.orbits())
        if (period % found.orbit.period == 0) orbits.push_back(found.orbit);
    const std::vector<int> sums = index_sums(orbits, period);
    return sums.front() == sums.back();
}

void StartSearch::from_variants(int period, bool compare) {
    for (double edge = variants_edge; edge <= coarsest_edge && !stopped(); edge *= edge_ratio) {
        const auto loops = loops_of(period, edge, variants);
        if (!loops) continue;
        // What is known to be missing is rare: all are tried.
        const bool missing = compare && !indices_agree(period);
        const std::size_t before = list_.orbits().size();
        solve(loops->size(), StartOrigin::joined, missing ? loops->size() : options_.patience,
              [&](std::size_t k) { return (*loops)[k]; });
        if (!missing && list_.orbits().size() == before) return;
    }
}

void StartSearch::from_orbits(int period, std::size_t& used, std::size_t most) {
    StabilisedOptions stabilised;
    stabilised.flow = coarse_.flow;
    const std::vector<MatrixXd> matrices = stabilising_matrices(chart_.dimension());
    std::vector<VectorXd> seeds;
    for (; used < list_.orbits().size(); ++used) {
        const FoundOrbit& found = list_.orbits()[used];
        if (found.orbit.period == period || found.origin == StartOrigin::symmetry) continue;
        for (Index j = 0; j < found.orbit.points.cols(); ++j)
            seeds.push_back(found.orbit.points.col(j));
    }
    std::vector<std::pair<std::uint64_t, std::size_t>> order;  // mixed, so that any first part is a fair sample
    for (std::size_t k = 0; k < seeds.size() * matrices.size(); ++k)
        order.emplace_back(models::splitmix64_finalizer(k), k);
    std::sort(order.begin(), order.end());
    solve(std::min(most, order.size()), StartOrigin::orbit, options_.patience, [&](std::size_t i) {
        const std::size_t k = order[i].second;
        return stabilised_start(chart_, seeds[k / matrices.size()], period, matrices[k % matrices.size()], stabilised)
            .value_or(MatrixXd());
    });
}

std::optional<std::vector<MatrixXd>> StartSearch::loops_of(int period, double edge, std::size_t most) const {
    const SectionCells cells(section_.system, pieces_.size, edge, signs_);
    const PseudoOrbits joined(pieces_, cells, angle_coordinates(section_.system));
    const auto loops = joined.loops(period, options_.loops);
    if (!loops) return std::nullopt;
    std::vector<std::uint64_t> known;
    for (const FoundOrbit& found : list_.orbits())
        if (found.orbit.period == period) known.push_back(itinerary_name(cells, found.orbit.points));
    std::sort(known.begin(), known.end());
    // The closest start of every loop, then the next closest ones.
    std::vector<std::vector<MatrixXd>> ranked(most);
    for (const auto& loop : *loops) {
        std::vector<MatrixXd> starts = joined.starts(loop, most);
        for (std::size_t rank = 0; rank < starts.size(); ++rank)
            if (most > 1 || !std::binary_search(known.begin(), known.end(), itinerary_name(cells, starts[rank])))
                ranked[rank].push_back(std::move(starts[rank]));
    }
    std::vector<MatrixXd> starts;
    for (std::vector<MatrixXd>& rank : ranked)
        std::move(rank.begin(), rank.end(), std::back_inserter(starts));
    return starts;
}

VectorXd StartSearch::on_section(const VectorXd& x) const {
    if (!section_.section) return x;
    const VectorXd& normal = section_.section->normal;
    return x + normal * ((section_.section->offset - normal.dot(x)) / normal.squaredNorm());
}

}  // namespace orbid::periodic

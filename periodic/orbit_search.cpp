#include "periodic/orbit_search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include <tbb/parallel_for.h>

#include "periodic/model_section.hpp"
#include "periodic/multiple_shooting.hpp"
#include "periodic/orbit_list.hpp"
#include "periodic/recurrence_start.hpp"
#include "periodic/whole_turn.hpp"

namespace orbid::periodic {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Starts that are solved before the list is looked at again: the result depends on it, not on the number of threads.
constexpr std::size_t batch = 256;

/// Accuracy of the flow while a start is closed, and of its closing.
constexpr double coarse_flow = 1e-8;
constexpr double coarse_closing = 1e-6;

/// Edge of the cells that tell itineraries apart, relative to the section.
constexpr double cell = 0.05;

void require(bool holds, const std::string& message) {
    if (!holds) throw std::invalid_argument("search_orbits: " + message);
}

void validate(const models::System& system, const VectorXd& theta, const OrbitSearchOptions& options) {
    const auto text = [](auto value) { return std::to_string(value); };
    require(theta.size() == static_cast<Index>(system.parameters().size()) && theta.allFinite(),
            "theta needs one finite value for each of the " + text(system.parameters().size()) + " parameters");
    require(!options.periods.empty(), "periods must not be empty");
    for (const int period : options.periods) {
        require(period >= 1, "periods must be >= 1, got " + text(period));
        require(std::count(options.periods.begin(), options.periods.end(), period) == 1,
                "periods must differ, " + text(period) + " stands twice");
    }
    require(std::isfinite(options.phase), "phase must be finite");
    require(options.points >= 100, "points must be >= 100, got " + text(options.points));
    require(options.trajectories >= 1, "trajectories must be >= 1");
    require(options.patience >= 1, "patience must be >= 1");
    require(options.widest > 0.0 && options.widest <= 0.5, "widest must lie in (0, 0.5], got " + text(options.widest));
    require(
        options.initial.cols() == 0 || (options.initial.rows() == system.dimension() && options.initial.allFinite()),
        "initial needs one finite state of " + text(system.dimension()) + " coordinates per column");
    const bool autonomous = system.kind() == models::Kind::autonomous;
    require(options.section.has_value() == autonomous,
            autonomous ? "an autonomous model needs a section" : "a section plane belongs to autonomous models");
    if (autonomous)
        require(options.section->normal.size() == system.dimension() && options.section->normal.allFinite() &&
                    options.section->normal.norm() > 0.0 && std::isfinite(options.section->offset),
                "the section's normal needs " + text(system.dimension()) + " finite numbers that are not all 0");
}

class Search {
public:
    Search(const ModelSection& section, const OrbitSearchOptions& options, const SectionPieces& pieces)
        : section_(section),
          options_(options),
          pieces_(pieces),
          list_(section, pieces.size, options.solver),
          coarse_(options.solver) {
        coarse_.scale = pieces.size;
        coarse_.maximum_distance = std::numeric_limits<double>::infinity();
        coarse_.tolerance = std::max(options.solver.tolerance, coarse_closing);
        coarse_.flow.relative_tolerance = std::max(options.solver.flow.relative_tolerance, coarse_flow);
        coarse_.flow.absolute_tolerance = std::max(options.solver.flow.absolute_tolerance, coarse_flow);
    }

    /// Solves starts in batches until they are all tried or long in vain. @param start_at  start number k.
    template <class StartAt>
    void solve(std::size_t count, StartOrigin origin, const StartAt& start_at) {
        std::size_t idle = 0;
        for (std::size_t done = 0; done < count; done += batch) {
            const std::size_t size = std::min(batch, count - done);
            std::vector<MatrixXd> closed(size);
            tbb::parallel_for(std::size_t{0}, size, [&](std::size_t k) {
                StartingSolution start;
                start.phase = section_.phase;
                start.section = section_.section;
                start.points = start_at(done + k);
                if (start.points.cols() == 0) return;
                const PeriodicOrbit orbit =
                    solve_multiple_shooting(section_.system, section_.theta, start, {}, coarse_);
                if (orbit.status == OrbitStatus::converged || orbit.status == OrbitStatus::shorter_period)
                    closed[k] = orbit.points;
            });
            starts_ += size;
            for (const MatrixXd& points : closed) {
                ++idle;
                if (points.cols() == 0) continue;
                if (list_.add(points, origin, options_.symmetry)) idle = 0;
            }
            if (idle >= options_.patience && 4 * idle >= done + size) return;
        }
    }

    void from_recurrences(int period) {
        const auto starts = recurrence_starts(section_.system, pieces_, period, options_.widest, cell, signs());
        solve(starts.size(), StartOrigin::recurrence, [&](std::size_t k) { return starts[k].points(pieces_, period); });
    }

    [[nodiscard]] const OrbitList& list() const { return list_; }
    [[nodiscard]] std::size_t starts() const { return starts_; }

private:
    /// Signs of a symmetry that maps the section onto itself.
    [[nodiscard]] std::vector<double> signs() const {
        const auto symmetry = section_.system.symmetry();
        if (!options_.symmetry || !symmetry || symmetry->phase_shift != 0.0) return {};
        if (section_.section) {
            const VectorXd& normal = section_.section->normal;
            for (Index i = 0; i < normal.size(); ++i)
                if (normal(i) != 0.0 && symmetry->signs[static_cast<std::size_t>(i)] != 1.0) return {};
        }
        return symmetry->signs;
    }

    const ModelSection& section_;
    const OrbitSearchOptions& options_;
    const SectionPieces& pieces_;
    OrbitList list_;
    ShootingOptions coarse_;
    std::size_t starts_ = 0;
};

/// The orbits asked for, by period, rotation and points; mirrors renumbered.
std::vector<FoundOrbit> ordered(const std::vector<FoundOrbit>& found, const std::vector<int>& periods) {
    std::vector<std::size_t> order;
    for (std::size_t k = 0; k < found.size(); ++k)
        if (std::find(periods.begin(), periods.end(), found[k].orbit.period) != periods.end()) order.push_back(k);
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
        const PeriodicOrbit& left = found[a].orbit;
        const PeriodicOrbit& right = found[b].orbit;
        if (left.period != right.period) return left.period < right.period;
        if (left.rotation != right.rotation) return left.rotation < right.rotation;
        return std::lexicographical_compare(left.points.data(), left.points.data() + left.points.size(),
                                            right.points.data(), right.points.data() + right.points.size());
    });
    std::vector<int> place(found.size(), -1);
    for (std::size_t k = 0; k < order.size(); ++k)
        place[order[k]] = static_cast<int>(k);
    std::vector<FoundOrbit> result;
    for (const std::size_t k : order) {
        result.push_back(found[k]);
        if (found[k].mirror >= 0) result.back().mirror = place[static_cast<std::size_t>(found[k].mirror)];
    }
    return result;
}

}  // namespace

std::string_view name(StartOrigin origin) {
    switch (origin) {
        case StartOrigin::recurrence:
            return "recurrence";
        case StartOrigin::symmetry:
            return "symmetry";
        case StartOrigin::orbit:
            return "orbit";
        case StartOrigin::code:
            return "code";
        case StartOrigin::scattered:
            return "scattered";
    }
    return "unknown";
}

OrbitSearch search_orbits(const models::System& system, const VectorXd& theta, const OrbitSearchOptions& options) {
    validate(system, theta, options);
    models::FlowOptions coarse = options.solver.flow;
    coarse.relative_tolerance = std::max(coarse.relative_tolerance, coarse_flow);
    coarse.absolute_tolerance = std::max(coarse.absolute_tolerance, coarse_flow);
    const ModelSection section{system, theta, options.phase, options.section,
                               longest_return(system, theta, options.section, options.seed, coarse)};
    const SectionPieces pieces =
        simulate_pieces(section, {options.points, options.trajectories, options.seed, options.initial, coarse});
    Search search(section, options, pieces);
    std::vector<int> periods = options.periods;
    std::sort(periods.begin(), periods.end());
    for (const int period : periods)
        search.from_recurrences(period);
    OrbitSearch result;
    result.orbits = ordered(search.list().orbits(), options.periods);
    result.starts = search.starts();
    result.captured = pieces.captured;
    return result;
}

}  // namespace orbid::periodic

#include "periodic/solution/orbit_report.hpp"

#include <cmath>
#include <cstddef>
#include <numbers>

namespace orbid::periodic {
namespace {

/// Shares of an orbit that differ by less are the same node: they are sums of a few thousand rounded numbers.
constexpr double same_share = 1e-11;

/// State and sensitivity (shape (n, f)) of a solved orbit at one instant.
struct Instant {
    bool simulated = false;
    VectorXd state;
    MatrixXd sensitivity;
    double time = 0.0;  ///< since the first node [s]
};

/// A solved orbit, of which any instant can be asked.
struct SolvedOrbit {
    const OrbitProblem& problem;
    const Discretisation& discretisation;
    const MatrixXd& nodes;
    const MatrixXd& sensitivities;
    double time;

    /// The last node at or before a share (strictly before: `strictly`), or the first one.
    [[nodiscard]] Index node_before(double share, bool strictly) const {
        Index node = 0;
        for (Index j = 1; j < nodes.cols(); ++j)
            if (discretisation.share(j) < share + (strictly ? -same_share : same_share)) node = j;
        return node;
    }

    [[nodiscard]] bool is_node(double share) const {
        return std::abs(discretisation.share(node_before(share, false)) - share) <= same_share;
    }

    [[nodiscard]] Instant at_node(Index j) const {
        const StepImage x = discretisation.state(j, nodes.col(j), time, problem.free);
        Instant instant{x.simulated, x.value, {}, discretisation.share(j) * time};
        if (problem.free.empty() || !x.simulated) return instant;
        const Index d = nodes.rows();
        instant.sensitivity = x.by_state * sensitivities.middleRows(d * j, d) + x.by_parameters;
        if (discretisation.unknown_time()) instant.sensitivity += x.by_ln_time * sensitivities.bottomRows(1);
        return instant;
    }

    /// By the flow from the node before; forced models only.
    [[nodiscard]] Instant between_nodes(double share) const {
        const Index j = node_before(share, false);
        Instant instant = at_node(j);
        if (!instant.simulated) return instant;
        const double periods = static_cast<double>(problem.start.points.cols());
        const double orbit = periods * problem.system.period(problem.theta, models::Clock::phase);
        const double durations[] = {(share - discretisation.share(j)) * orbit};
        const auto flow = problem.system.flow_with_sensitivities(
            instant.state, problem.start.phase + std::fmod(discretisation.share(j) * orbit, 2.0 * std::numbers::pi),
            durations, problem.theta, problem.free, models::Clock::phase, problem.options.flow);
        instant.simulated = flow.status == models::FlowStatus::ok;
        instant.time = share * time;
        move(instant, flow.states, flow.sensitivities);
        return instant;
    }

    /// The crossing of the section nearest to a share.
    [[nodiscard]] Instant crossing_near(double share) const {
        const Index j = node_before(share, true);
        Instant instant = at_node(j);
        if (!instant.simulated) return instant;
        const double expected = share * time - instant.time;
        // A node that lies on the section may be off it by rounding, and then crosses it at once.
        const auto crossing = problem.system.crossings(instant.state, *problem.start.section, 2, 2.0 * expected,
                                                       problem.theta, problem.free, problem.options.flow);
        Index nearest = -1;
        for (Index k = 0; k < crossing.times.size(); ++k)
            if (nearest < 0 || std::abs(crossing.times(k) - expected) < std::abs(crossing.times(nearest) - expected))
                nearest = k;
        instant.simulated = nearest >= 0;
        if (nearest < 0) return instant;
        instant.time += crossing.times(nearest);
        const Index directions = free_count() + problem.system.dimension();
        move(instant, crossing.states.col(nearest),
             crossing.sensitivities.middleCols(nearest * directions, directions));
        return instant;
    }

    [[nodiscard]] Index free_count() const { return static_cast<Index>(problem.free.size()); }

    void move(Instant& instant, const MatrixXd& state, const MatrixXd& derivative) const {
        if (!instant.simulated) return;
        instant.state = state.col(0);
        if (problem.free.empty()) return;
        const Index n = problem.system.dimension();
        instant.sensitivity = derivative.leftCols(n) * instant.sensitivity + derivative.rightCols(free_count());
    }
};

}  // namespace

OrbitPoints points_at(const OrbitProblem& problem, const Discretisation& discretisation, const MatrixXd& nodes,
                      const MatrixXd& sensitivities, const std::vector<double>& shares, double time) {
    const SolvedOrbit orbit{problem, discretisation, nodes, sensitivities, time};
    const Index n = problem.system.dimension();
    const Index f = orbit.free_count();
    const bool all = shares.empty();
    const Index count = all ? nodes.cols() : static_cast<Index>(shares.size());
    OrbitPoints points;
    points.states.resize(n, count);
    points.times.resize(count);
    if (f > 0) points.sensitivities.resize(n * count, f);
    bool only_nodes = true;
    for (Index k = 0; k < count; ++k) {
        const double share = all ? discretisation.share(k) : shares[static_cast<std::size_t>(k)];
        const bool node = all || orbit.is_node(share);
        if (node)
            points.nodes.push_back(all ? k : orbit.node_before(share, false));
        else
            only_nodes = false;
        const Instant instant = k > 0 && problem.start.section ? orbit.crossing_near(share)
                                : node                         ? orbit.at_node(points.nodes.back())
                                                               : orbit.between_nodes(share);
        if (!instant.simulated) return points;
        points.states.col(k) = instant.state;
        points.times(k) = instant.time;
        if (f > 0) points.sensitivities.middleRows(n * k, n) = instant.sensitivity;
    }
    if (!only_nodes) points.nodes.clear();
    points.simulated = true;
    return points;
}

std::vector<MatrixXd> merged_factors(const std::vector<MatrixXd>& factors, const std::vector<Index>& nodes) {
    std::vector<MatrixXd> merged;
    for (std::size_t k = 0; k < nodes.size(); ++k) {
        auto j = static_cast<std::size_t>(nodes[k]);
        const auto end = k + 1 < nodes.size() ? static_cast<std::size_t>(nodes[k + 1]) : factors.size();
        MatrixXd product = factors[j];
        for (++j; j < end; ++j)
            product = factors[j] * product;
        merged.push_back(std::move(product));
    }
    return merged;
}

std::vector<MatrixXd> condensed_factors(const std::vector<MatrixXd>& factors) {
    std::vector<MatrixXd> condensed;
    double room = 0.0;  // |X - 1| bounds the logarithm of the growth from above
    for (const MatrixXd& factor : factors) {
        const double size = (factor - MatrixXd::Identity(factor.rows(), factor.cols())).norm();
        if (!condensed.empty() && size <= room) {
            condensed.back() = factor * condensed.back();
            room -= size;
        } else {
            condensed.push_back(factor);
            room = 2.0 - size;
        }
    }
    return condensed;
}

}  // namespace orbid::periodic

#include "identification/starts/course_repair.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <numbers>
#include <tuple>
#include <utility>

#include <tbb/parallel_for.h>

#include "identification/starts/piece_estimate.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/records/reading_noise.hpp"

namespace orbid::identification {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Between two nodes, where a course may go on with other signs.
struct Crossing {
    std::size_t place = 0, segment = 0;
    Index node = 0;  ///< the last one before the signs turn
    VectorXd signs;
    double distance = 0.0;  ///< from the end of the interval to the other side of the next node, over the ranges
    // What the pieces tell.
    double gain = -std::numeric_limits<double>::infinity();
    Index first = 0;  ///< node of the piece
    MatrixXd nodes;   ///< of the piece, with the signs turned
    std::uint64_t work = 0;
};

/// Sizes of the coordinates: a turn of angles, else from the smallest to the largest at a node.
VectorXd sizes_of(const models::System& system, const std::vector<MatrixXd>& segments) {
    const Index n = system.dimension();
    VectorXd least = VectorXd::Constant(n, std::numeric_limits<double>::infinity()), most = -least;
    for (const MatrixXd& nodes : segments) {
        least = least.cwiseMin(nodes.rowwise().minCoeff());
        most = most.cwiseMax(nodes.rowwise().maxCoeff());
    }
    VectorXd size = most - least;
    for (Index i = 0; i < n; ++i)
        if (system.coordinates()[static_cast<std::size_t>(i)].angle) size[i] = 2.0 * std::numbers::pi;
    return size;
}

double distance(const models::System& system, const VectorXd& a, const VectorXd& b, const VectorXd& size) {
    double sum = 0.0;
    for (Index i = 0; i < a.size(); ++i) {
        double d = (a[i] - b[i]) / size[i];
        if (system.coordinates()[static_cast<std::size_t>(i)].angle) d -= std::nearbyint(d);
        sum += d * d;
    }
    return std::sqrt(sum);
}

VectorXd signs_of(const IdentificationProblem& problem, const std::vector<std::string>& turned) {
    VectorXd signs = VectorXd::Ones(problem.system->dimension());
    for (const std::string& name : turned)
        signs[problem.system->coordinate_index(name)] = -1.0;
    return signs;
}

/// Whether nearly all intervals of a segment meet: a course with a few places on the wrong side, and no mere set of
/// nodes.
bool is_course(const models::System& system, const MatrixXd& nodes, const MatrixXd& ends, const VectorXd& size) {
    constexpr double apart = 0.02, most = 0.1;
    Index missed = 0;
    for (Index k = 0; k < ends.cols(); ++k)
        if (!(distance(system, ends.col(k), nodes.col(k + 1), size) < apart)) ++missed;
    return static_cast<double>(missed) <= most * static_cast<double>(ends.cols());
}

/// Places of one segment where the other side is nearest.
void add_crossings(const models::System& system, const VectorXd& signs, const MatrixXd& nodes, const MatrixXd& ends,
                   const VectorXd& size, const Crossing& where, std::vector<Crossing>& found) {
    constexpr double farthest = 0.3;
    const Index links = ends.cols();
    VectorXd other(links);
    for (Index k = 0; k < links; ++k)
        other[k] = distance(system, ends.col(k), signs.cwiseProduct(nodes.col(k + 1)), size);
    for (Index k = 0; k < links; ++k) {
        if (!(other[k] < farthest)) continue;
        if ((k > 0 && other[k - 1] < other[k]) || (k + 1 < links && other[k + 1] <= other[k])) continue;
        Crossing& one = found.emplace_back(where);
        one.node = k;
        one.signs = signs;
        one.distance = other[k];
    }
}

std::vector<Crossing> crossings(const IdentificationProblem& problem, const SignChoices& choices,
                                const SeriesStart& start, const estimator::Estimate& estimate) {
    constexpr std::size_t most = 64;
    const models::System& system = *problem.system;
    const Index n = system.dimension();
    std::vector<Crossing> found;
    for (std::size_t place = 0; place < start.nodes.size(); ++place) {
        const VectorXd size = sizes_of(system, start.nodes[place]);
        if (!(size.array() > 0.0).all()) continue;
        std::size_t block = 0;  // of the residual
        if (place >= estimate.residuals.size()) break;
        for (std::size_t s = 0; s < start.nodes[place].size(); ++s) {
            const MatrixXd& nodes = start.nodes[place][s];
            MatrixXd ends(n, std::max<Index>(nodes.cols() - 1, 0));
            for (Index k = 0; k < ends.cols(); ++k) {
                const VectorXd& e = estimate.residuals[place][block + static_cast<std::size_t>(k)].e;
                ends.col(k) = e.size() < n ? VectorXd::Constant(n, std::numeric_limits<double>::quiet_NaN())
                                           : VectorXd(nodes.col(k + 1) - e.tail(n));
            }
            block += static_cast<std::size_t>(nodes.cols());
            if (!is_course(system, nodes, ends, size)) continue;
            for (const auto& turned : choices) {
                Crossing where;
                where.place = place;
                where.segment = s;
                add_crossings(system, signs_of(problem, turned), nodes, ends, size, where, found);
            }
        }
    }
    std::stable_sort(found.begin(), found.end(),
                     [](const Crossing& a, const Crossing& b) { return a.distance < b.distance; });
    if (found.size() > most) found.resize(most);
    return found;
}

/// Nodes to either side of a crossing that its piece has.
Index half_of(const IdentificationProblem& problem, const SeriesStart& start, const Crossing& one) {
    constexpr double turns = 1.5;
    constexpr Index fewest = 4, most = 50;
    const Experiment& data = problem.experiments[problem.series->data[one.place]];
    const std::size_t segment = data.fitted_segments()[one.segment];
    const orbits::Segment& readings = data.series->segments[segment];
    double samples = std::numeric_limits<double>::infinity();
    for (Index row = 0; row < readings.values.rows(); ++row)
        samples = std::min(samples, orbits::samples_per_turn(readings.values.row(row).transpose()));
    const double nodes = turns * samples / static_cast<double>(start.intervals[one.place]);
    return std::clamp(static_cast<Index>(std::ceil(std::min(nodes, 1e6))), fewest, most);
}

/// A piece with these nodes, estimated by itself.
PieceEstimate piece_from(const IdentificationProblem& problem, const EstimateSetup& setup,
                         const std::vector<estimator::FreeParameter>& near, const SeriesStart& start,
                         const SeriesPiece& piece, const MatrixXd& nodes, const estimator::EstimateOptions& options,
                         const RepairLimits& limits) {
    try {
        const auto residual = shooting_piece(problem, setup, start, piece, nodes, limits.flow);
        return piece_estimate(near, *residual, options, limits.work);
    } catch (const orbits::DataError&) {  // a piece without readings
        return {};
    }
}

/// Takes over what pieces that do not overlap have gained, the best ones first.
void take_over(const std::vector<Crossing>& list, CourseRepair& repair) {
    constexpr double least = 1.0;
    std::vector<const Crossing*> taken;
    std::vector<const Crossing*> order;
    for (const Crossing& one : list)
        order.push_back(&one);
    std::stable_sort(order.begin(), order.end(), [](auto* a, auto* b) { return a->gain > b->gain; });
    for (const Crossing* one : order) {
        if (!(one->gain > least)) break;
        const bool apart = std::none_of(taken.begin(), taken.end(), [&](const Crossing* other) {
            return other->place == one->place && other->segment == one->segment &&
                   one->first < other->first + other->nodes.cols() && other->first < one->first + one->nodes.cols();
        });
        if (apart) taken.push_back(one);
    }
    std::sort(taken.begin(), taken.end(), [](auto* a, auto* b) {
        return std::tie(a->place, a->segment, a->first) < std::tie(b->place, b->segment, b->first);
    });
    VectorXd turned;  // by the crossings before, in the same segment
    for (std::size_t k = 0; k < taken.size(); ++k) {
        const Crossing& one = *taken[k];
        if (k == 0 || one.place != taken[k - 1]->place || one.segment != taken[k - 1]->segment)
            turned = VectorXd::Ones(one.signs.size());
        MatrixXd& nodes = repair.start.nodes[one.place][one.segment];
        nodes.middleCols(one.first, one.nodes.cols()) = turned.asDiagonal() * one.nodes;
        const Index after = nodes.cols() - one.first - one.nodes.cols();
        nodes.rightCols(after) = (one.signs.asDiagonal() * nodes.rightCols(after)).eval();
        turned = turned.cwiseProduct(one.signs);
        ++repair.changed;
        repair.gain += one.gain;
    }
}

}  // namespace

CourseRepair repaired_course(const IdentificationProblem& problem, const EstimateSetup& setup,
                             const std::vector<estimator::FreeParameter>& parameters, const SignChoices& signs,
                             const SeriesStart& start, const estimator::Estimate& estimate,
                             const estimator::EstimateOptions& options, const RepairLimits& limits) {
    CourseRepair repair;
    repair.start = start;
    std::vector<Crossing> list = crossings(problem, signs, start, estimate);
    const std::vector<estimator::FreeParameter> near = nearly_held(parameters, estimate);
    tbb::parallel_for(std::size_t{0}, list.size(), [&](std::size_t i) {
        Crossing& one = list[i];
        const MatrixXd& all = start.nodes[one.place][one.segment];
        const Index half = half_of(problem, start, one);
        one.first = std::max<Index>(0, one.node + 1 - half);
        const Index end = std::min(all.cols(), one.node + 1 + half);
        const SeriesPiece piece{one.place, one.segment, one.first};
        MatrixXd nodes = all.middleCols(one.first, end - one.first);
        const PieceEstimate same = piece_from(problem, setup, near, start, piece, nodes, options, limits);
        const Index after = end - (one.node + 1);
        nodes.rightCols(after) = (one.signs.asDiagonal() * nodes.rightCols(after)).eval();
        const PieceEstimate other = piece_from(problem, setup, near, start, piece, nodes, options, limits);
        one.work = same.work + other.work;
        if (other.nodes.size() == 0) return;
        one.gain = same.objective - other.objective;
        // Its first part may be what has turned.
        const MatrixXd turned = one.signs.asDiagonal() * other.nodes;
        one.nodes = (turned - nodes).squaredNorm() < (other.nodes - nodes).squaredNorm() ? turned : other.nodes;
    });
    for (const Crossing& one : list)
        repair.work += one.work;
    take_over(list, repair);
    return repair;
}

}  // namespace orbid::identification

#include "periodic/search/stabilised_start.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

#include "models/arithmetic/lu_factor.hpp"
#include "models/arithmetic/orthogonal_factor.hpp"
#include "periodic/orbit/winding_number.hpp"

namespace orbid::periodic {

SectionChart::SectionChart(const ModelSection& section, VectorXd size)
    : section_(section), size_(std::move(size)), angles_(angle_coordinates(section.system)) {
    const Index n = section.system.dimension();
    basis_ = MatrixXd::Identity(n, n);
    if (!section.section) return;
    const VectorXd normal = size_.asDiagonal() * section.section->normal;
    basis_ = models::HouseholderFactor(normal).q().rightCols(n - 1);
}

VectorXd SectionChart::moved(const VectorXd& x, const VectorXd& by) const {
    return wrapped_angles(x + size_.asDiagonal() * (basis_ * by), angles_);
}

SectionReturn SectionChart::returned(const VectorXd& x, int period, const models::FlowOptions& flow) const {
    const models::System& system = section_.system;
    const Index n = system.dimension();
    SectionReturn result;
    MatrixXd states;
    MatrixXd last;
    if (section_.section) {
        const auto found = system.crossings(x, *section_.section, static_cast<std::size_t>(period), section_.longest,
                                            section_.theta, std::span<const Index>{}, flow);
        if (found.status != models::FlowStatus::ok || found.states.cols() < period) return result;
        states = found.states;
        last = found.sensitivities.middleCols((period - 1) * n, n);
    } else {
        const bool forced = system.kind() == models::Kind::forced;
        const models::Clock clock = forced ? models::Clock::phase : models::Clock::time;
        const double full = forced ? system.period(section_.theta, clock) : 1.0;
        std::vector<double> durations;
        for (int k = 1; k <= period; ++k)
            durations.push_back(full * k);
        const auto found =
            system.flow_with_sensitivities(x, section_.phase, durations, section_.theta, {}, clock, flow);
        if (found.status != models::FlowStatus::ok) return result;
        states = found.states;
        last = found.sensitivity(period - 1, n);
    }
    if (!states.allFinite() || !last.allFinite()) return result;
    const VectorXd inverse = size_.cwiseInverse();
    result.gap = basis_.transpose() * (inverse.asDiagonal() * wrapped_angles(states.col(period - 1) - x, angles_));
    result.jacobian = basis_.transpose() * inverse.asDiagonal() * last * size_.asDiagonal() * basis_;
    result.points.resize(n, period);
    result.points.col(0) = x;
    result.points.rightCols(period - 1) = states.leftCols(period - 1);
    result.points = wrapped_angles(result.points, angles_);
    result.simulated = true;
    return result;
}

std::vector<MatrixXd> stabilising_matrices(Index dimension) {
    const MatrixXd one = MatrixXd::Identity(dimension, dimension);
    if (dimension > 6) return {one, -one};
    std::vector<MatrixXd> matrices;
    const auto count = std::size_t{1} << static_cast<std::size_t>(dimension);
    std::vector<Index> order(static_cast<std::size_t>(dimension));
    std::iota(order.begin(), order.end(), Index{0});
    do {
        for (std::size_t signs = 0; signs < count; ++signs) {
            MatrixXd c = MatrixXd::Zero(dimension, dimension);
            for (Index i = 0; i < dimension; ++i)
                c(i, order[static_cast<std::size_t>(i)]) = (signs >> static_cast<std::size_t>(i)) & 1U ? -1.0 : 1.0;
            matrices.push_back(c);
        }
        if (dimension == 2) {
            matrices.pop_back();  // -1 serves points that repel in all directions
            break;
        }
    } while (dimension <= 3 && std::next_permutation(order.begin(), order.end()));
    return matrices;
}

std::optional<MatrixXd> stabilised_start(const SectionChart& chart, const VectorXd& from, int period, const MatrixXd& c,
                                         const StabilisedOptions& options) {
    const MatrixXd one = MatrixXd::Identity(chart.dimension(), chart.dimension());
    // Farther than twice the section from its start an iteration follows nothing any more.
    constexpr double farthest = 2.0;
    VectorXd x = from;
    VectorXd way = VectorXd::Zero(chart.dimension());
    for (int k = 0; k < options.maximum_iterations; ++k) {
        const SectionReturn image = chart.returned(x, period, options.flow);
        if (!image.simulated) return std::nullopt;
        const double size = image.gap.norm();
        if (k > 0 && size < options.closed) return image.points;
        const MatrixXd matrix = options.beta * size * c.transpose() - (image.jacobian - one);
        const VectorXd step = models::LuFactor(matrix).solve(image.gap);
        way += step;
        if (!step.allFinite() || !(way.norm() < farthest)) return std::nullopt;
        x = chart.moved(x, step);
    }
    return std::nullopt;
}

}  // namespace orbid::periodic

#include "periodic/discretisation/closing_error.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include <tbb/parallel_for.h>

#include "models/system/left_loop.hpp"
#include "periodic/orbit/full_turn.hpp"

namespace orbid::periodic {

StepImage Discretisation::state(Index /*j*/, const VectorXd& z, double /*time*/, std::span<const Index> free) const {
    StepImage image;
    image.simulated = true;
    image.value = z;
    image.by_state = MatrixXd::Identity(z.size(), z.size());
    if (unknown_time()) image.by_ln_time = VectorXd::Zero(z.size());
    image.by_parameters = MatrixXd::Zero(z.size(), static_cast<Index>(free.size()));
    return image;
}

std::vector<StepImage> Discretisation::advance_all(const MatrixXd& nodes, double time, std::span<const Index> free,
                                                   std::span<const int> /*pieces*/) const {
    std::vector<StepImage> images(static_cast<std::size_t>(nodes.cols()));
    tbb::parallel_for(Index{0}, nodes.cols(),
                      [&](Index j) { images[static_cast<std::size_t>(j)] = advance(j, nodes.col(j), time, free); });
    models::stop_if_left();
    return images;
}

std::vector<double> equidistant(Index steps) {
    std::vector<double> shares;
    for (Index j = 0; j < steps; ++j)
        shares.push_back(static_cast<double>(j) / static_cast<double>(steps));
    return shares;
}

ClosingError closing_error(const Discretisation& discretisation, const MatrixXd& nodes, double time) {
    return closing_error(discretisation, nodes, time, MatrixXd::Zero(nodes.rows(), nodes.cols()));
}

ClosingError closing_error(const Discretisation& discretisation, const MatrixXd& nodes, double time,
                           const MatrixXd& turns, std::span<const Index> free, std::span<const int> pieces) {
    const Index d = nodes.rows();
    const Index count = nodes.cols();
    const auto f = static_cast<Index>(free.size());
    ClosingError result;
    result.error.resize(d, count);
    result.jacobians.resize(static_cast<std::size_t>(count));
    result.by_ln_time.resize(d * count, discretisation.unknown_time() ? 1 : 0);
    result.parameters.resize(d * count, f);
    // ln T is the unknown: a step of a few hundred is infinite in T, or nothing.
    if (discretisation.unknown_time() && !(time > 0.0 && std::isfinite(time))) return result;
    std::vector<StepImage> images = discretisation.advance_all(nodes, time, free, pieces);
    result.simulated = true;
    for (Index j = 0; j < count; ++j) {
        const auto slot = static_cast<std::size_t>(j);
        StepImage& image = images[slot];
        if (!image.simulated || !image.value.allFinite() || !image.by_state.allFinite() ||
            !image.by_parameters.allFinite() || !image.by_ln_time.allFinite()) {
            result.simulated = false;
            continue;
        }
        result.error.col(j) = image.value - nodes.col((j + 1) % count) - full_turn * turns.col(j);
        if (image.pieces.empty()) result.factors.push_back(image.by_state);
        result.factors.insert(result.factors.end(), image.pieces.begin(), image.pieces.end());
        result.jacobians[slot] = std::move(image.by_state);
        if (discretisation.unknown_time()) result.by_ln_time.col(0).segment(d * j, d) = image.by_ln_time;
        if (f > 0) result.parameters.middleRows(d * j, d) = image.by_parameters;
        result.sticking = result.sticking || image.sticking;
    }
    return result;
}

}  // namespace orbid::periodic

#include "orbits/local_maps/cross_validation.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <tbb/parallel_for.h>

#include "models/arithmetic/cholesky_factor.hpp"
#include "models/arithmetic/median.hpp"
#include "orbits/local_maps/fit_limits.hpp"
#include "orbits/local_maps/monomials.hpp"

namespace orbid::orbits {
namespace {

// Directions without spread (thin neighbourhoods of clean data) are not extrapolated along: part of the mean diagonal
// of the normal matrix added to it.
constexpr double ridge = 1e-10;

// The weight function vanishes at this multiple of the farthest neighbour's squared distance.
constexpr double margin = 1.1;

// Places at which sizes of neighbourhoods are compared.
constexpr std::size_t trial_places = 256;

// Of fits whose median squared residuals lie within this factor of the smallest the one with most neighbours is used:
// its gradients scatter least.
constexpr double equally_good = 1.05;

// Sizes of neighbourhoods, in numbers of coefficients. Most neighbours: more average nothing that matters here.
constexpr std::array<std::size_t, 7> held_out_sizes{3, 6, 12, 24, 48, 96, 192};
constexpr std::size_t most_held_out_neighbours = 800;

CrossValidation held_out_fit(const SectionPoints& points, const NeighbourIndex& grid, std::size_t t,
                             const Monomials& monomials, std::size_t k) {
    const Eigen::Index n = points.dimension(), coefficients = monomials.count(monomials.highest());
    const Eigen::VectorXd centre = Eigen::Map<const Eigen::VectorXd>(points.point(t), n);
    const Eigen::VectorXd image = Eigen::Map<const Eigen::VectorXd>(points.point(t + 1), n);
    const std::vector<Neighbour> members = grid.nearest(centre, k + (points.symmetric() ? 2 : 1));
    CrossValidation fit;
    if (members.empty()) return fit;
    const double radius2 = margin * members.back().distance2;
    if (!(radius2 > 0.0)) return fit;
    const double radius = std::sqrt(radius2);
    const auto rows = static_cast<Eigen::Index>(members.size());
    Eigen::MatrixXd design(rows, coefficients), images(rows, n);
    Eigen::VectorXd weights(rows), offset(n), row(coefficients);
    Eigen::Index kept = 0;
    for (const Neighbour& member : members) {
        if (member.index == t) continue;
        const double* x = points.point(member.index);
        const double* y = points.point(member.index + 1);
        bool whole = true;
        for (Eigen::Index d = 0; d < n; ++d) {
            const double sign = member.mirrored ? points.signs()[d] : 1.0;
            offset[d] = points.difference(sign * x[d], centre[d], d) / radius;
            images(kept, d) = points.difference(sign * y[d], image[d], d);
            if (points.is_angle(d) && !(std::abs(images(kept, d)) < torn_turns)) whole = false;
        }
        if (!whole) return fit;
        const double w = 1.0 - member.distance2 / radius2;
        weights[kept] = w * w;
        monomials.evaluate(offset.data(), coefficients, row.data());
        design.row(kept++) = row;
    }
    if (kept < coefficients + 2) return fit;
    const auto used = Eigen::seqN(0, kept);
    const Eigen::MatrixXd x = design(used, Eigen::all), y = images(used, Eigen::all);
    const Eigen::VectorXd w = weights.head(kept);
    Eigen::MatrixXd normal = x.transpose() * w.asDiagonal() * x;
    normal.diagonal().array() += ridge * normal.trace() / static_cast<double>(coefficients);
    const models::CholeskyFactor factor(normal);
    if (!factor.positive_definite()) return fit;
    // Row by row, the order in which Eigen takes this product for itself: by columns it rounds differently.
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const RowMajor right = x.transpose() * (w.asDiagonal() * y);
    const Eigen::MatrixXd solution = factor.solve(right);
    const Eigen::MatrixXd left = y - x * solution;
    const double total = w.sum();
    // Of the kept points' weights the fit uses up as much as unweighted points would of their number.
    const double freedom = 1.0 - static_cast<double>(coefficients) / static_cast<double>(kept);
    fit.residual = -solution.row(0).transpose();
    fit.gradient = solution.middleRows(1, n).transpose() / radius;
    fit.covariance = left.transpose() * w.asDiagonal() * left / (total * freedom);
    fit.covariance.diagonal().array() += rounding_variance;
    fit.usable = fit.residual.allFinite() && fit.gradient.allFinite() && fit.covariance.allFinite();
    return fit;
}

struct Trial {
    double square;  // median of the squared residuals
    FitSize size;
};

}  // namespace

std::vector<CrossValidation> held_out_fits(const SectionPoints& points, const NeighbourIndex& grid,
                                           const std::vector<std::size_t>& places, const FitSize& size) {
    const Monomials monomials(points.dimension(), size.order);
    std::vector<CrossValidation> fits(places.size());
    // Every index writes its own slot: the same bytes with any number of threads.
    tbb::parallel_for(std::size_t{0}, places.size(), [&](std::size_t i) {
        fits[i] = held_out_fit(points, grid, places[i], monomials, size.neighbours);
    });
    return fits;
}

std::optional<FitSize> best_held_out_size(const SectionPoints& points, const NeighbourIndex& grid,
                                          const std::vector<std::size_t>& places) {
    std::vector<std::size_t> some;
    const std::size_t step = std::max<std::size_t>(1, places.size() / trial_places);
    for (std::size_t i = 0; i < places.size(); i += step)
        some.push_back(places[i]);
    std::vector<Trial> trials;
    for (const int order : {1, 2, 3})
        for (const std::size_t size : held_out_sizes) {
            const std::size_t k = size * static_cast<std::size_t>(coefficient_count(points.dimension(), order));
            if (k > most_held_out_neighbours || 4 * k > points.image_count()) continue;
            std::vector<double> squares;
            for (const CrossValidation& fit : held_out_fits(points, grid, some, {order, k}))
                if (fit.usable) squares.push_back(fit.residual.squaredNorm());
            if (2 * squares.size() < some.size()) continue;
            trials.push_back({models::upper_median(std::move(squares)), {order, k}});
        }
    if (trials.empty()) return std::nullopt;
    const auto smallest = std::min_element(trials.begin(), trials.end(),
                                           [](const Trial& a, const Trial& b) { return a.square < b.square; });
    FitSize best{trials.front().size.order, 0};
    for (const Trial& trial : trials)
        if (trial.square <= equally_good * smallest->square && trial.size.neighbours > best.neighbours)
            best = trial.size;
    return best;
}

}  // namespace orbid::orbits

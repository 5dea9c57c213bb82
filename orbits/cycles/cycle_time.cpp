#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "orbits/cycles/cycle_candidate.hpp"
#include "orbits/local_maps/fit_limits.hpp"
#include "orbits/local_maps/local_polynomial.hpp"
#include "orbits/local_maps/monomials.hpp"

namespace orbid::orbits {
namespace {

// Sizes of neighbourhoods tried, in numbers of coefficients.
constexpr std::array<std::size_t, 6> sizes{3, 6, 12, 24, 48, 96};
constexpr std::size_t most_neighbours = 2000;

// Errors of times never fall below the rounding of times of this size, with room for the digits that reading loses.
constexpr double time_rounding = 1e-14;

struct TimeFit {
    double value = 0.0;     // [s]
    Eigen::VectorXd slope;  // [s per scaled unit]
    double sd = std::numeric_limits<double>::infinity();
};

struct Support {
    Eigen::MatrixXd offsets;   // shape (k, n), nearest first
    Eigen::VectorXd distance;  // shape (k)
    Eigen::VectorXd times;     // shape (k) [s]
};

Support gather_support(const SectionPoints& points, const NeighbourIndex& grid, const Eigen::VectorXd& place,
                       std::size_t k) {
    const Eigen::Index n = points.dimension();
    const std::vector<Neighbour> members = grid.nearest(place, k);
    Support support;
    support.offsets.resize(static_cast<Eigen::Index>(members.size()), n);
    support.distance.resize(support.offsets.rows());
    support.times.resize(support.offsets.rows());
    Eigen::Index kept = 0;
    std::vector<double> reference(static_cast<std::size_t>(n));
    for (const Neighbour& member : members) {
        bool whole = true;
        for (Eigen::Index d = 0; d < n; ++d) {
            const double sign = member.mirrored ? points.signs()[d] : 1.0;
            const double image = sign * points.point(member.index + 1)[d];
            if (kept == 0) reference[static_cast<std::size_t>(d)] = image;
            support.offsets(kept, d) = points.difference(sign * points.point(member.index)[d], place[d], d);
            whole = whole && std::abs(points.difference(image, reference[static_cast<std::size_t>(d)], d)) < torn_turns;
        }
        if (!whole) break;
        support.distance[kept] = std::sqrt(member.distance2);
        support.times[kept++] = points.return_time(member.index);
    }
    support.offsets.conservativeResize(kept, n);
    support.distance.conservativeResize(kept);
    support.times.conservativeResize(kept);
    return support;
}

std::optional<TimeFit> fit(const Support& support, int order, Eigen::Index k) {
    if (k > support.times.size()) return std::nullopt;
    const LocalPolynomial found = fit_local_polynomial(support.offsets.topRows(k), support.times.head(k),
                                                       radius_margin * support.distance[k - 1], order);
    if (!found.usable) return std::nullopt;
    return TimeFit{found.value[0], found.slope.row(0).transpose(),
                   std::sqrt(found.residual(0, 0) * found.leverage) + time_rounding * std::abs(found.value[0])};
}

// The best fit, its sd with the difference to the second-best in it.
std::optional<TimeFit> best_fit(const SectionPoints& points, const NeighbourIndex& grid, const Eigen::VectorXd& place) {
    const Support support = gather_support(points, grid, place, std::min(most_neighbours, points.image_count() / 4));
    std::vector<TimeFit> fits;
    for (const int order : {1, 2, 3})
        for (const std::size_t size : sizes) {
            const auto k = static_cast<Eigen::Index>(size) * coefficient_count(points.dimension(), order);
            if (const auto found = fit(support, order, k)) fits.push_back(*found);
        }
    if (fits.empty()) return std::nullopt;
    std::stable_sort(fits.begin(), fits.end(), [](const TimeFit& a, const TimeFit& b) { return a.sd < b.sd; });
    TimeFit best = fits.front();
    if (fits.size() > 1) best.sd = std::hypot(best.sd, fits[1].value - best.value);
    return best;
}

}  // namespace

void time_cycle(const SectionPoints& points, const NeighbourIndex& grid, CycleCandidate& draft) {
    draft.time = draft.time_sd = std::numeric_limits<double>::quiet_NaN();
    if (!points.timed()) return;
    const Eigen::Index n = draft.points.rows(), p = draft.points.cols();
    Eigen::VectorXd slope(n * p);
    double time = 0.0, variance = 0.0;
    for (Eigen::Index j = 0; j < p; ++j) {
        const auto found = best_fit(points, grid, draft.points.col(j));
        if (!found) return;
        time += found->value;
        variance += found->sd * found->sd;
        slope.segment(j * n, n) = found->slope;
    }
    if (draft.covariance.rows() == n * p) variance += slope.dot(draft.covariance * slope);
    draft.time = time;
    draft.time_sd = std::sqrt(variance);
}

}  // namespace orbid::orbits

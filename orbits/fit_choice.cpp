#include "orbits/fit_choice.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace orbid::orbits {

namespace {

// Neighbours per coefficient: the smallest fits, and the factor from one size to the next.
constexpr double smallest_share = 2.0;
constexpr double growth = 2.0;

// Fits of more neighbours cost more than they gain.
constexpr std::size_t most_neighbours = 4000;

// A size that has not become better twice in a row ends an order's growth: a single step may be bad luck.
constexpr int patience = 2;

// Values known to this (scaled units) are known to rounding: no size is better.
constexpr double rounding = 1e-14;

}  // namespace

FitChoice::FitChoice(const SectionPoints& section, const BoxGrid& grid, int order, std::size_t neighbours)
    : section_(section), grid_(grid), neighbours_(neighbours) {
    if (order > 0) lowest_ = highest_ = order;
    most_ = std::clamp<std::size_t>(section.image_count() / 10, 1, most_neighbours);
    monomials_ = std::make_shared<const Monomials>(section.dimension(), highest_ + 2);
}

RankedFits FitChoice::ranked(const Eigen::VectorXd& place) const {
    RankedFits result;
    PolynomialFit workspace;
    std::vector<LocalMap> fits;
    std::vector<std::size_t> sizes;
    Neighbourhood near;
    std::size_t gathered = 0;
    const auto at_least = [&](std::size_t k) {
        if (k <= gathered) return;
        near = gather_neighbourhood(section_, grid_, place, k);
        gathered = k;
    };
    for (int order = highest_; order >= lowest_; --order) {
        const auto coefficients = static_cast<double>(monomials_->count(order));
        double best = std::numeric_limits<double>::infinity();
        int worse = 0;
        for (double size = smallest_share * coefficients; worse < patience; size *= growth) {
            const auto k = neighbours_ > 0
                               ? neighbours_
                               : std::max(static_cast<std::size_t>(size), static_cast<std::size_t>(coefficients) + 6);
            if (!sizes.empty() && k > most_) break;
            at_least(k);
            const LocalMap map = fit_local_map(section_, near, order, k, monomials_, workspace);
            const bool torn = static_cast<std::size_t>(near.offsets.rows()) < std::min(k, gathered);
            if (map.usable) {
                worse = map.value_sd < best ? 0 : worse + 1;
                best = std::min(best, map.value_sd);
                fits.push_back(map);
                sizes.push_back(std::min(k, static_cast<std::size_t>(near.offsets.rows())));
            } else {
                ++worse;
            }
            if (neighbours_ > 0 || torn || best < rounding) break;
        }
    }
    std::vector<std::size_t> rank(fits.size());
    std::iota(rank.begin(), rank.end(), std::size_t{0});
    std::stable_sort(rank.begin(), rank.end(),
                     [&](std::size_t a, std::size_t b) { return fits[a].value_sd < fits[b].value_sd; });
    for (const std::size_t at : rank) {
        result.fits.push_back(std::move(fits[at]));
        result.sizes.push_back(sizes[at]);
    }
    result.neighbours = std::move(near);
    return result;
}

}  // namespace orbid::orbits

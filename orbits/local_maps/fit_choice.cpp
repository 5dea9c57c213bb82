#include "orbits/local_maps/fit_choice.hpp"

#include <algorithm>
#include <limits>

namespace orbid::orbits {
namespace {

// Neighbours per coefficient: the smallest fits, and the factor from one size to the next.
constexpr std::size_t smallest_fit_share = 2;
constexpr std::size_t fit_growth = 2;

// Fits of more neighbours cost more than they gain.
constexpr std::size_t most_fit_neighbours = 1500;

// A size that has not become better twice in a row ends an order's growth: a single step may be bad luck.
constexpr int patience = 2;

// An order whose best fit is worse than the best of the lower orders by this factor is the last that is tried.
constexpr double hopeless = 2.0;

// Values known to this (scaled units) are known to rounding: no size is better.
constexpr double known_to_rounding = 1e-14;

}  // namespace

FitChoice::FitChoice(const SectionPoints& section, const NeighbourIndex& grid, int order, std::size_t neighbours)
    : section_(section), grid_(grid), neighbours_(neighbours) {
    if (order > 0) lowest_ = highest_ = order;
    most_ = std::clamp<std::size_t>(section.image_count() / 10, 1, most_fit_neighbours);
    monomials_ = std::make_shared<const Monomials>(section.dimension(), highest_ + 2);
}

std::vector<FitSize> FitChoice::best(const Eigen::VectorXd& place) const {
    struct Tried {
        FitSize size;
        double error;
    };
    std::vector<Tried> tried;
    PolynomialFit workspace;
    Neighbourhood near;
    std::size_t gathered = 0;
    double best_of_all = std::numeric_limits<double>::infinity();
    for (int order = lowest_; order <= highest_; ++order) {
        const auto coefficients = static_cast<std::size_t>(monomials_->count(order));
        double best = std::numeric_limits<double>::infinity();
        int worse = 0;
        for (std::size_t k = std::max(smallest_fit_share * coefficients, coefficients + 6); worse < patience;
             k *= fit_growth) {
            if (neighbours_ > 0) k = neighbours_;
            if (best < std::numeric_limits<double>::infinity() && k > most_) break;
            if (k > gathered) {
                near = gather_neighbourhood(section_, grid_, place, k);
                gathered = k;
            }
            const bool torn = static_cast<std::size_t>(near.offsets.rows()) < std::min(k, gathered);
            const LocalMap map = fit_local_map(section_, near, order, k, monomials_, workspace);
            worse = map.usable && map.value_sd < best ? 0 : worse + 1;
            if (map.usable) {
                tried.push_back({{order, k}, map.value_sd});
                best = std::min(best, map.value_sd);
            }
            if (neighbours_ > 0 || torn || best < known_to_rounding) break;
        }
        // Orders beyond one that has become worse by far do not come back.
        if (best > hopeless * best_of_all) break;
        best_of_all = std::min(best_of_all, best);
    }
    std::stable_sort(tried.begin(), tried.end(), [](const Tried& a, const Tried& b) { return a.error < b.error; });
    std::vector<FitSize> sizes;
    if (tried.empty()) return sizes;
    const FitSize first = tried.front().size;
    sizes.push_back(first);
    for (const bool same_order : {false, true}) {
        const auto other = std::find_if(tried.begin() + 1, tried.end(), [&](const Tried& candidate) {
            return (candidate.size.order == first.order) == same_order;
        });
        if (other != tried.end()) sizes.push_back(other->size);
    }
    return sizes;
}

PlacedFits FitChoice::fitted(const Eigen::VectorXd& place, const std::vector<FitSize>& sizes) const {
    PlacedFits result;
    std::size_t most = 0;
    for (const FitSize& size : sizes)
        most = std::max(most, size.neighbours);
    result.neighbours = gather_neighbourhood(section_, grid_, place, most);
    PolynomialFit workspace;
    for (const FitSize& size : sizes)
        result.fits.push_back(
            fit_local_map(section_, result.neighbours, size.order, size.neighbours, monomials_, workspace));
    return result;
}

}  // namespace orbid::orbits

#include "orbits/local_maps/cell_map.hpp"

#include <algorithm>
#include <cmath>

#include <tbb/parallel_for.h>

#include "models/arithmetic/median.hpp"
#include "models/arithmetic/splitmix64.hpp"

namespace orbid::orbits {
namespace {

// Neighbours per coefficient of the smallest fits: 21 for the 6 coefficients of order 2 in two dimensions (prototypes
// on the pendulum found as many cycles with 20 as with 30 for the 10 coefficients of order 3).
constexpr double cell_share = 3.4;

// Larger neighbourhoods are tried in these steps; one that does not bring the median error down to this part is not
// worth its truncation elsewhere.
constexpr std::size_t neighbourhood_growth = 4;
constexpr double worthwhile = 0.7;
constexpr std::size_t cell_places = 128;

// The error that leave-one-out shows does not hold the polynomials' truncation where noise hides it: wider
// neighbourhoods are not trusted.
constexpr double largest_radius = 0.04;

// Cells are not made smaller than this: what is right in the middle of a cell is good enough for a search in all of it,
// and coarser maps carry Newton farther. Measured on 2^20 sections of the pendulum, boxes of 40 %, true cycles of
// period 5: 284 with 1/256, 322 with 1/128, 340 with 1/64, 342 with 1/32, in the same time within a tenth.
constexpr double smallest_edge = 1.0 / 64.0;
constexpr double largest_edge = 0.04;

// A neighbourhood of which a fit, the point itself left out, explains less than 91 % of the variance is no map
// (shuffled points: nothing); a place whose image is not known to this (scaled units) lies beyond the data.
constexpr double cell_unexplained = 0.3;
constexpr double largest_error = 0.01;

// Values known to this (scaled units) are known well enough for any search.
constexpr double well_known = 1e-12;

}  // namespace

CellMap::CellMap(const SectionPoints& section, const NeighbourIndex& grid, int order, std::size_t neighbours)
    : section_(section), grid_(grid), order_(order > 0 ? order : 2) {
    const Eigen::Index n = section.dimension();
    monomials_ = std::make_shared<const Monomials>(n, order_);
    terms_ = monomials_->count(order_);
    choose_neighbours(neighbours);
    for (Eigen::Index d = 0; d < n; ++d) {
        const bool angle = section.is_angle(d);
        cells_per_unit_.push_back(angle ? std::max(1.0, std::floor(1.0 / edge_)) : 1.0 / edge_);
    }
}

void CellMap::choose_neighbours(std::size_t asked) {
    const auto least = static_cast<std::size_t>(std::ceil(cell_share * static_cast<double>(terms_)));
    std::vector<std::size_t> starts;
    const std::size_t stride = std::max<std::size_t>(1, section_.size() / cell_places);
    for (std::size_t i = stride / 2; i < section_.size(); i += stride)
        if (section_.has_image(i)) starts.push_back(i);
    const auto with_remainder = std::make_shared<const Monomials>(section_.dimension(), order_ + 2);
    double best = 0.0;
    for (std::size_t k = asked > 0 ? asked : least;; k *= neighbourhood_growth) {
        if (neighbours_ > 0 && k > section_.image_count() / 10) break;
        std::vector<double> errors(starts.size()), radii(starts.size());
        tbb::parallel_for(std::size_t{0}, starts.size(), [&](std::size_t i) {
            const Eigen::Map<const Eigen::VectorXd> place(section_.point(starts[i]), section_.dimension());
            PolynomialFit workspace;
            const Neighbourhood near = gather_neighbourhood(section_, grid_, place, k);
            const LocalMap map = fit_local_map(section_, near, order_, k, with_remainder, workspace);
            errors[i] = map.usable ? map.value_sd : 1.0;
            radii[i] = near.radius;
        });
        const double error = models::upper_median(errors);
        const double radius = models::upper_median(radii);
        if (neighbours_ > 0 && (!(error < worthwhile * best) || radius > largest_radius)) break;
        best = error;
        neighbours_ = k;
        edge_ = std::clamp(radius, smallest_edge, largest_edge);
        if (asked > 0 || error < well_known) break;
    }
}

const CellMap::Cell& CellMap::cell_of(const double* x) const {
    std::uint64_t key = 0;
    for (std::size_t d = 0; d < cells_per_unit_.size(); ++d)
        key = models::splitmix64(
            key ^ static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(x[d] * cells_per_unit_[d]))));
    const auto found = cells_.find(key);
    if (found != cells_.end()) return found->second;
    return cells_.emplace(key, fitted(x)).first->second;
}

CellMap::Cell CellMap::fitted(const double* x) const {
    const Eigen::Index n = section_.dimension();
    Eigen::VectorXd centre(n);
    for (Eigen::Index d = 0; d < n; ++d) {
        const double cells = cells_per_unit_[static_cast<std::size_t>(d)];
        centre[d] = (std::floor(x[d] * cells) + 0.5) / cells;
    }
    // Around a point of the series, not around the middle of the cell: on attractors thinner than a cell the data say
    // nothing about a place beside them.
    const std::vector<Neighbour> nearest = grid_.nearest(centre, 1);
    // A neighbouring cell's points may serve, those farther off may not.
    if (nearest.empty() || !(nearest.front().distance2 <= static_cast<double>(n) * edge_ * edge_)) return {};
    const double* point = section_.point(nearest.front().index);
    for (Eigen::Index d = 0; d < n; ++d)
        centre[d] = nearest.front().mirrored ? section_.signs()[d] * point[d] : point[d];
    PolynomialFit workspace;
    const Neighbourhood near = gather_neighbourhood(section_, grid_, centre, neighbours_);
    const LocalMap map = fit_local_map(section_, near, order_, neighbours_, monomials_, workspace);
    Cell cell;
    cell.usable = map.usable && map.left_out <= cell_unexplained * map.image_spread && map.value_sd <= largest_error;
    if (!cell.usable) return cell;
    cell.inverse_radius = 1.0 / map.radius;
    cell.numbers = std::make_unique<double[]>(static_cast<std::size_t>(2 * n + n * terms_));
    double* to = cell.numbers.get();
    to = std::copy_n(centre.data(), n, to);
    to = std::copy_n(near.reference.data(), n, to);
    std::copy_n(map.coefficients.data(), n * terms_, to);
    return cell;
}

void CellMap::evaluate(const Cell& cell, const double* x, double* image, double* jacobian, double* values) const {
    const Eigen::Index n = section_.dimension();
    const double* centre = cell.numbers.get();
    const double* reference = centre + n;
    const double* coefficients = reference + n;
    double* t = image;  // its memory, until the monomials are known
    for (Eigen::Index d = 0; d < n; ++d)
        t[d] = section_.difference(x[d], centre[d], d) * cell.inverse_radius;
    monomials_->evaluate(t, terms_, values);
    std::copy_n(reference, n, image);
    std::fill_n(jacobian, n * n, 0.0);
    for (Eigen::Index m = 0; m < terms_; ++m) {
        const double* c = coefficients + m * n;
        for (Eigen::Index row = 0; row < n; ++row)
            image[row] += c[row] * values[m];
        for (Eigen::Index a = 0; a < n; ++a) {
            const int exponent = monomials_->exponent(m, a);
            if (exponent == 0) continue;
            const double slope = exponent * cell.inverse_radius * values[monomials_->lowered(m, a)];
            for (Eigen::Index row = 0; row < n; ++row)
                jacobian[a * n + row] += c[row] * slope;
        }
    }
}

}  // namespace orbid::orbits

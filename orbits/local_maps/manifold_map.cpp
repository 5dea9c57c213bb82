#include "orbits/local_maps/manifold_map.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include <tbb/parallel_for.h>

#include "models/arithmetic/eigenvalues.hpp"
#include "models/arithmetic/triangular_solve.hpp"
#include "orbits/local_maps/fit_limits.hpp"
#include "orbits/local_maps/local_polynomial.hpp"
#include "orbits/local_maps/monomials.hpp"
#include "orbits/local_maps/sheet_support.hpp"

namespace orbid::orbits {
namespace {

// A direction is one along the sheet when the neighbours' variance there is so many times that of the readings. What is
// left across is noise (one times), what is less spread has no direction yet.
constexpr double spread_variance = 4.0;

// Mean square across the sheet, in reading errors, that is still noise: they are known to 10 % or so, and the sheet may
// have a thickness of 0.7 of them.
constexpr double noise_only = 1.5;

// Places looked at for the dimension of the sheet, and the share of them that must agree: on the curves of Lorenz and
// Roessler at 1 % noise 91 to 97 % do, on Henon's set at 0.01, 0.1 and 0.5 % at most 63 %.
constexpr std::size_t dimension_places = 200;
constexpr double agreeing = 0.85;
constexpr std::size_t places_at_once = 40;

// Fewest and most neighbours tried; each size is half as large again as the one before. Readings of a dense record blur
// a place over hundreds of points.
constexpr std::size_t least_neighbours = 16;
constexpr std::size_t most_manifold_neighbours = 8192;

// Fits of one order and growing neighbourhoods are used as long as the intervals of so many sds about their values have
// a point in common (intersection of confidence intervals: Goldenshluger and Nemirovski 1997): truncation, which
// residuals hide under the noise, then stays within the sds.
constexpr double agreement = 2.0;

// Reading errors (sds) within which a place is blurred.
constexpr double blurred = 3.0;

}  // namespace

ManifoldMapFits::ManifoldMapFits(const SectionPoints& points, const NeighbourIndex& grid, Eigen::MatrixXd reading_error)
    : points_(&points), grid_(&grid), error_(std::move(reading_error)) {
    whitening_.setIdentity(error_.rows(), error_.cols());
    models::solve_lower_in_place(error_, whitening_);
}

namespace {

void keep_weights(ManifoldMap& map, const SheetSupport& support, Eigen::Index kept, const Eigen::VectorXd& weights) {
    map.support.assign(support.members.begin(), support.members.begin() + kept);
    map.weights = weights;
    map.fitted = {map.slope * map.along, (map.time_slope.transpose() * map.along).transpose()};
}

// Of those within a window, the others have none.
Eigen::VectorXd spread_out(const Eigen::VectorXd& weights, const std::vector<Eigen::Index>& within, Eigen::Index all) {
    Eigen::VectorXd result = Eigen::VectorXd::Zero(all);
    result(within) = weights;
    return result;
}

}  // namespace

ManifoldMap ManifoldMapFits::fit(const Eigen::VectorXd& place, int order, std::size_t neighbours) const {
    return fit(sheet_support(*points_, *grid_, whitening_, place, neighbours), order, neighbours, true);
}

ManifoldMap ManifoldMapFits::fit(const SheetSupport& support, int order, std::size_t neighbours, bool backwards) const {
    const SectionPoints& points = *points_;
    const Eigen::Index n = points.dimension();
    ManifoldMap map;
    map.centre = support.centre;
    map.order = order;
    map.neighbours = neighbours;
    if (neighbours == 0 || neighbours > support.kept.size()) return map;
    const Eigen::Index kept = support.kept[neighbours - 1];
    if (2 * kept < static_cast<Eigen::Index>(neighbours)) return map;
    const auto z = support.z.topRows(kept);
    const auto values = support.values.topRows(kept);

    const Eigen::RowVectorXd mean = z.colwise().mean();
    const Eigen::MatrixXd centred = z.rowwise() - mean;
    const models::SymmetricEigen spread =
        models::symmetric_eigen(centred.transpose() * centred / static_cast<double>(kept));
    Eigen::Index k = 0;
    while (k < n && spread.values[n - 1 - k] > spread_variance)
        ++k;
    if (k == 0) return map;
    const Eigen::MatrixXd directions = spread.vectors.rowwise().reverse();
    const Eigen::MatrixXd along = directions.leftCols(k);
    const Eigen::MatrixXd t = z * along;
    const double radius = radius_margin * std::sqrt(t.rowwise().squaredNorm().maxCoeff());
    Eigen::MatrixXd all(kept, n + 1 + n - k);
    all << values, z * directions.rightCols(n - k);
    const LocalPolynomial found = fit_local_polynomial(t, all, radius, order, 1.0);  // errors of t: 1
    if (!found.usable) return map;
    map.offset = found.value.head(n);
    map.value = points.wrapped(support.reference + map.offset);
    map.slope = found.slope.topRows(n);
    map.along = along.transpose() * whitening_;
    map.tangent = error_ * along;
    map.time = found.value[n];
    map.time_slope = found.slope.row(n).transpose();
    map.image_covariance = found.residual.topLeftCorner(n + 1, n + 1);
    // At least what the reading errors make of it: residuals of few neighbours may be small by luck.
    const Eigen::MatrixXd expected = error_ * error_.transpose() + map.slope * map.slope.transpose();
    for (Eigen::Index d = 0; d < n; ++d)
        map.image_covariance(d, d) = std::max(map.image_covariance(d, d), expected(d, d));
    map.covariance = found.leverage * map.image_covariance;
    keep_weights(map, support, kept, found.weights);
    map.slope_leverage = found.slope_leverage;
    // The errors along the sheet enter what is left across it through its slope.
    for (Eigen::Index d = 0; d < n - k; ++d)
        map.thickness = std::max(
            map.thickness, found.residual(n + 1 + d, n + 1 + d) / (1.0 + found.slope.row(n + 1 + d).squaredNorm()));
    const Eigen::MatrixXd images = values.leftCols(n);
    const double variance = (images.rowwise() - images.colwise().mean()).squaredNorm() / static_cast<double>(kept);
    map.unexplained = variance > 0.0 ? std::sqrt(map.image_covariance.topLeftCorner(n, n).trace() / variance) : 1.0;
    map.significance = (1.0 / (map.unexplained * map.unexplained) - 1.0) * static_cast<double>(kept) /
                       static_cast<double>(coefficient_count(k, order));
    const double below = (t.col(0).array() < 0.0).cast<double>().mean();
    map.beside = std::min(below, 1.0 - below);
    map.usable = true;
    if (k == 1 && backwards) read_backwards(map, t, values, order);
    return map;
}

void ManifoldMapFits::read_backwards(ManifoldMap& map, const Eigen::MatrixXd& t, const Eigen::MatrixXd& values,
                                     int order) const {
    const Eigen::Index n = points_->dimension();
    Eigen::VectorXd direction = whitening_ * map.slope;
    const double stretch = direction.norm();
    const double reach = t.cwiseAbs().maxCoeff() - blurred;
    if (!(stretch > 1.0) || !(reach > 1.0)) return;
    direction /= stretch;
    map.measure = whitening_.transpose() * direction;
    const Eigen::VectorXd all = values.leftCols(n) * map.measure;
    // The window in the image must hold no image of a place beyond the neighbours, errors included.
    const double radius = stretch * reach;
    const double start = direction.dot(whitening_ * map.offset);
    double origin = start;
    for (int round = 0; round < 4; ++round) {
        std::vector<Eigen::Index> within;
        for (Eigen::Index i = 0; i < all.size(); ++i)
            if (std::abs(all[i] - origin) < radius) within.push_back(i);
        const auto count = static_cast<Eigen::Index>(within.size());
        Eigen::MatrixXd u(count, 1), pair(count, 2);
        Eigen::Index below = 0;
        for (Eigen::Index i = 0; i < count; ++i) {
            const Eigen::Index at = within[static_cast<std::size_t>(i)];
            u(i, 0) = all[at] - origin;
            pair(i, 0) = t(at, 0);
            pair(i, 1) = values(at, n);
            below += u(i, 0) < 0.0 ? 1 : 0;
        }
        const LocalPolynomial found = fit_local_polynomial(u, pair, radius, order, 1.0);
        if (!found.usable || !(found.slope(0, 0) > 0.0)) {
            map.usable = false;
            return;
        }
        // Where points grow denser an image read here comes rather from there (Tweedie's formula).
        const double denser = u.mean() / (u.squaredNorm() / static_cast<double>(count));
        const double slope = found.slope(0, 0), time_slope = found.slope(1, 0);
        const double step = -(found.value[0] - denser * slope) / slope;
        if (round < 3) {
            origin += std::clamp(step, -0.5 * radius, 0.5 * radius);
            continue;
        }
        map.backward_weights = spread_out(found.weights, within, all.size());
        const Eigen::VectorXd& unit = map.unit = error_ * direction;
        Eigen::MatrixXd across = Eigen::MatrixXd::Identity(n, n) - unit * direction.transpose() * whitening_;
        const Eigen::MatrixXd covariance = across * map.covariance.topLeftCorner(n, n) * across.transpose();
        map.value = points_->wrapped(map.value + unit * (origin + step - start));
        map.slope = unit / slope;
        map.time = found.value[1] - denser * time_slope + time_slope * step;
        map.time_slope[0] = time_slope / slope;
        // An error of t at the image moves the image back by its multiple.
        Eigen::MatrixXd moved(n + 1, 2);
        moved << -unit / slope, Eigen::VectorXd::Zero(n), -time_slope / slope, 1.0;
        map.covariance = found.leverage * moved * found.residual * moved.transpose();
        map.covariance.topLeftCorner(n, n) += covariance;
        map.image_covariance.topLeftCorner(n, n) = unit * unit.transpose() * (found.residual(0, 0) / (slope * slope));
        map.slope_leverage[0] = found.slope_leverage[0] / (slope * slope);
        const double share = static_cast<double>(below) / static_cast<double>(count);
        map.beside = std::min(share, 1.0 - share);
    }
}

ManifoldMap ManifoldMapFits::best(const Eigen::VectorXd& place) const {
    const Eigen::Index n = points_->dimension();
    const std::size_t most = std::min(most_manifold_neighbours, points_->image_count() / 4);
    const SheetSupport support = sheet_support(*points_, *grid_, whitening_, place, most);
    // Fits of as few dimensions as there are win: where the sheet is folded within the errors there are only others.
    const auto better = [n](const ManifoldMap& a, const ManifoldMap& b) {
        if (!b.usable || a.sheet_dimension() != b.sheet_dimension())
            return !b.usable || a.sheet_dimension() < b.sheet_dimension();
        return a.covariance.topLeftCorner(n, n).trace() < b.covariance.topLeftCorner(n, n).trace();
    };
    ManifoldMap best, second;
    for (const int order : {2, 3}) {  // a linear fit knows no curvature to take the smearing away
        Eigen::VectorXd low = Eigen::VectorXd::Constant(n + 1, -std::numeric_limits<double>::infinity());
        Eigen::VectorXd high = -low;
        Eigen::VectorXd first;
        for (std::size_t k = least_neighbours; k <= most; k += k / 2) {
            ManifoldMap map = fit(support, order, k, true);
            if (!map.usable || !(map.thickness <= noise_only)) continue;
            if (first.size() == 0) first = map.value;
            Eigen::VectorXd value(n + 1);
            value.head(n) = points_->difference(map.value, first);
            value[n] = map.time;
            const Eigen::VectorXd sd = map.covariance.diagonal().cwiseSqrt();
            low = low.cwiseMax(value - agreement * sd);
            high = high.cwiseMin(value + agreement * sd);
            if (!((high - low).array() >= 0.0).all()) break;
            if (better(map, best)) {
                second = std::move(best);
                best = std::move(map);
            } else if (better(map, second)) {
                second = std::move(map);
            }
        }
    }
    if (best.usable && second.usable && best.sheet_dimension() == second.sheet_dimension()) {
        Eigen::VectorXd difference(n + 1);
        difference.head(n) = points_->difference(second.value, best.value);
        difference[n] = second.time - best.time;
        best.covariance += difference * difference.transpose();
        best.choice = difference;
    }
    return best;
}

Eigen::Index ManifoldMapFits::sheet_dimension_at(const Eigen::VectorXd& place) const {
    const Eigen::Index n = points_->dimension();
    const std::size_t most = std::min(most_manifold_neighbours, points_->image_count() / 4);
    const SheetSupport support = sheet_support(*points_, *grid_, whitening_, place, most);
    Eigen::Index least = n;
    for (const int order : {2, 3})
        for (std::size_t k = least_neighbours; k <= most; k += k / 2) {
            const ManifoldMap map = fit(support, order, k, false);
            if (map.usable && map.thickness <= noise_only) least = std::min(least, map.sheet_dimension());
        }
    return least;
}

Eigen::Index ManifoldMapFits::sheet_dimension() const {
    const Eigen::Index n = points_->dimension();
    const std::size_t stride = std::max<std::size_t>(1, points_->size() / dimension_places);
    std::vector<std::size_t> looked;
    for (std::size_t i = 0; i < points_->size(); i += stride)
        if (points_->has_image(i)) looked.push_back(i);
    std::vector<Eigen::Index> dimensions;  // n: no sheet
    const auto most_without = static_cast<std::ptrdiff_t>((1.0 - agreeing) * static_cast<double>(looked.size()));
    // In parts, each side by side: most sections are no sheets and show it soon.
    for (std::size_t start = 0; start < looked.size(); start += places_at_once) {
        std::vector<Eigen::Index> found(std::min(places_at_once, looked.size() - start), n);
        tbb::parallel_for(std::size_t{0}, found.size(), [&](std::size_t i) {
            found[i] = sheet_dimension_at(Eigen::Map<const Eigen::VectorXd>(points_->point(looked[start + i]), n));
        });
        dimensions.insert(dimensions.end(), found.begin(), found.end());
        if (std::count(dimensions.begin(), dimensions.end(), n) > most_without) return n;
    }
    if (dimensions.empty()) return n;
    const auto enough = static_cast<std::ptrdiff_t>(agreeing * static_cast<double>(looked.size()));
    std::nth_element(dimensions.begin(), dimensions.begin() + enough, dimensions.end());
    return dimensions[static_cast<std::size_t>(enough)];
}

}  // namespace orbid::orbits

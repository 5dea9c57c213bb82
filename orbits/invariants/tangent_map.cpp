#include "orbits/invariants/tangent_map.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "models/arithmetic/eigenvalues.hpp"
#include "models/arithmetic/triangular_solve.hpp"
#include "orbits/local_maps/fit_limits.hpp"

namespace orbid::orbits {
namespace {

// Rounding of scaled coordinates of order one: residuals below it do not make a fit more exact.
constexpr double rounding = 1e-15;

// A gap in the images wider than this part of their range is a tear of the section: k >= 8 points of a smooth image
// leave such a gap where they lie in two groups themselves, and then dropping the farther group does no harm.
constexpr double tear = 0.5;
// Residuals beyond this part of the images' spread raise the suspicion of a tear.
constexpr double torn_residual = 0.1;
// Neighbours looked at on both sides of a tear, as a multiple of those wanted on one.
constexpr std::size_t torn_search = 3;

// A direction in the space of coefficients is resolved when its pivot (norm over the neighbours) is so many
// times the ratio of residual and spread of the images. Chosen on Lorenz and Roessler series with cubic maps: below 1
// the errors of integration across a Roessler section pass for a direction of their own, above 15 the third exponent
// of a Lorenz attractor (10^5 samples, 14.57) is 0.4 and more too low.
constexpr double resolved = 3.0;
// The smallest diagonal entry of the factor exceeds the smallest pivot by no more than this in practice.
constexpr double safe_diagonal = 100.0;

}  // namespace

TangentFitter::TangentFitter(const SectionPoints& points, const NeighbourIndex& grid, int order, std::size_t neighbours)
    : points_(&points), grid_(&grid), neighbours_(neighbours), monomials_(points.dimension(), order) {
    const Eigen::Index n = points.dimension(), k = static_cast<Eigen::Index>(torn_search * neighbours);
    offsets_.resize(k, n);
    images_.resize(k, n);
    weights_.resize(k);
}

void TangentFitter::gather(std::size_t i, std::size_t wanted) {
    const Eigen::Index n = points_->dimension();
    const Eigen::VectorXd place = Eigen::Map<const Eigen::VectorXd>(points_->point(i), n);
    const double* own_image = points_->point(i + 1);
    count_ = 0;
    double farthest2 = 0.0;
    for (const Neighbour& member : grid_->nearest(place, wanted + 1)) {
        if (member.index == i && !member.mirrored) continue;
        if (count_ == static_cast<Eigen::Index>(wanted)) break;
        const double* x = points_->point(member.index);
        const double* image = points_->point(member.index + 1);
        for (Eigen::Index d = 0; d < n; ++d) {
            const double sign = member.mirrored ? points_->signs()[d] : 1.0;
            offsets_(count_, d) = points_->difference(sign * x[d], place[d], d);
            images_(count_, d) = points_->difference(sign * image[d], own_image[d], d);
        }
        farthest2 = member.distance2;
        ++count_;
    }
    radius_ = radius_margin * std::sqrt(farthest2);
}

// Leaves the neighbours beyond a tear out; false when there is none.
bool TangentFitter::drop_torn() {
    if (count_ < 2) return false;
    const auto images = images_.topRows(count_);
    const Eigen::RowVectorXd mean = images.colwise().mean();
    const Eigen::MatrixXd spread = (images.rowwise() - mean).transpose() * (images.rowwise() - mean);
    const Eigen::VectorXd longest = models::symmetric_eigen(spread).vectors.rightCols<1>();
    const Eigen::VectorXd along = images * longest;
    std::vector<double> sorted(along.data(), along.data() + count_);
    std::sort(sorted.begin(), sorted.end());
    std::size_t upper = 1;
    for (std::size_t j = 1; j < sorted.size(); ++j)
        if (sorted[j] - sorted[j - 1] > sorted[upper] - sorted[upper - 1]) upper = j;
    if (!(sorted[upper] - sorted[upper - 1] > tear * (sorted.back() - sorted.front()))) return false;
    // The point's own image is at 0: its side stays.
    const double middle = 0.5 * (sorted[upper] + sorted[upper - 1]);
    Eigen::Index kept = 0;
    for (Eigen::Index row = 0; row < count_ && kept < static_cast<Eigen::Index>(neighbours_); ++row)
        if ((along[row] > middle) == (0.0 > middle)) {
            offsets_.row(kept) = offsets_.row(row).eval();
            images_.row(kept++) = images_.row(row).eval();
        }
    count_ = kept;
    if (count_ > 0) radius_ = radius_margin * offsets_.row(count_ - 1).norm();
    return true;
}

void TangentFitter::fill_design() {
    const Eigen::Index coefficients = monomials_.count(monomials_.highest());
    design_.resize(count_, coefficients);
    weights_.head(count_) =
        1.0 - offsets_.topRows(count_).rowwise().squaredNorm().array() / (radius_ * radius_);  // roots of the weights
    design_.col(0) = weights_.head(count_);
    for (Eigen::Index c = 1; c < coefficients; ++c) {
        const auto [earlier, coordinate] = monomials_.factor(c);
        design_.col(c) = design_.col(earlier).cwiseProduct(offsets_.col(coordinate).head(count_)) / radius_;
    }
    response_.noalias() = weights_.head(count_).asDiagonal() * images_.topRows(count_);
}

void TangentFitter::solve() {
    const Eigen::Index n = points_->dimension();
    const Eigen::Index coefficients = monomials_.count(monomials_.highest());
    map_.usable = false;
    if (count_ < coefficients + 2 || !(radius_ > 0.0)) return;
    fill_design();
    factor_.compute(design_);
    const double total = weights_.head(count_).squaredNorm();
    const double per_coordinate = total * static_cast<double>(n);
    const Eigen::RowVectorXd mean = weights_.head(count_).transpose() * response_ / total;
    map_.image_spread = std::sqrt((response_ - weights_.head(count_) * mean).squaredNorm() / per_coordinate) + rounding;
    factor_.apply_transposed_q(response_);
    const double freedom = static_cast<double>(count_ - coefficients) / static_cast<double>(count_);
    map_.residual =
        std::sqrt(response_.bottomRows(count_ - coefficients).squaredNorm() / (per_coordinate * freedom)) + rounding;

    triangle_ = factor_.packed().topRows(coefficients).triangularView<Eigen::Upper>();
    fitted_ = response_.topRows(coefficients);
    // A map need not stretch where its image turns back: the spread of the places counts as well.
    const double offset_variance =
        (weights_.head(count_).asDiagonal() * offsets_.topRows(count_)).squaredNorm() / per_coordinate;
    map_.image_spread = std::max(map_.image_spread, std::sqrt(offset_variance));
    const double threshold = resolved * map_.residual / map_.image_spread;
    truncated_ = !(triangle_.diagonal().cwiseAbs().minCoeff() > safe_diagonal * threshold);
    if (truncated_) {
        // The constant is not a direction: it is solved for last and never left out.
        const Eigen::Index free = coefficients - 1;
        const auto block = triangle_.bottomRightCorner(free, free);
        orthogonal_.compute(block, threshold / block.colwise().norm().maxCoeff());
        if (orthogonal_.rank() == 0) return;
        fitted_.bottomRows(free) = orthogonal_.solve(Eigen::MatrixXd(fitted_.bottomRows(free)));
        fitted_.row(0) -= triangle_.row(0).tail(free) * fitted_.bottomRows(free);
        fitted_.row(0) /= triangle_(0, 0);
    } else {
        models::solve_upper_in_place(triangle_, fitted_);  // shape (coefficients, n)
    }
    if (!fitted_.allFinite()) return;

    map_.jacobian = fitted_.middleRows(1, n).transpose() / radius_;
    map_.prediction_error = fitted_.row(0).norm();
    // residual = error of the image - A error of the place
    const double place_variance =
        map_.residual * map_.residual / (1.0 + map_.jacobian.squaredNorm() / static_cast<double>(n));
    map_.attenuation = place_variance / offset_variance;
    map_.usable = true;
}

double TangentFitter::image_sd(const Eigen::VectorXd& direction) const {
    Eigen::VectorXd combination = Eigen::VectorXd::Zero(triangle_.rows());
    combination.segment(1, direction.size()) = direction / radius_;
    if (truncated_) {
        // Block = Q T Z P^T, T of the rank's size: its pseudo-inverse transposed maps g to Q T^-T Z P^T g.
        const Eigen::Index rank = orthogonal_.rank();
        const Eigen::VectorXd turned = orthogonal_.row_space_coordinates(combination.tail(triangle_.rows() - 1));
        Eigen::VectorXd known = turned.head(rank);
        orthogonal_.solve_transposed_t_in_place(known);
        return std::hypot(map_.residual * known.norm(), map_.image_spread * turned.tail(turned.size() - rank).norm());
    }
    // (R^T R)^-1 = R^-1 R^-T: the sd of a combination g of coefficients is |R^-T g|.
    models::solve_transposed_upper_in_place(triangle_, combination);
    return map_.residual * combination.norm();
}

const TangentMap& TangentFitter::fit(std::size_t i) {
    gather(i, neighbours_);
    solve();
    if (map_.usable && map_.residual < torn_residual * map_.image_spread) return map_;
    // A fit that explains little may lie across a tear: once more with the neighbours on this side of it.
    if (!drop_torn()) return map_;
    const TangentMap before = map_;
    gather(i, torn_search * neighbours_);
    drop_torn();
    solve();
    if (before.usable && !(map_.usable && map_.residual < before.residual)) {
        gather(i, neighbours_);
        solve();
    }
    return map_;
}

}  // namespace orbid::orbits

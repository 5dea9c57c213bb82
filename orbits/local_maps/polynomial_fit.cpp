#include "orbits/local_maps/polynomial_fit.hpp"

#include <algorithm>
#include <cmath>

#include "models/arithmetic/triangular_solve.hpp"
#include "orbits/local_maps/fit_limits.hpp"
#include "orbits/local_maps/orthogonal_columns.hpp"

namespace orbid::orbits {
namespace {

// What is left of a column of the design after the columns before it, relative to the column: below this the
// direction is lost to rounding.
constexpr double lost_column = 1e-11;

// A row that the fit reproduces whatever its value cannot be left out: its share of its own prediction is kept this
// far from one.
constexpr double largest_share = 1.0 - 1e-6;

// Coefficients of the second of the remainder's two orders over those of the first, in units of the radius, as in a
// convergent series.
constexpr double second_order_share = 0.5;

}  // namespace

bool PolynomialFit::fit(const Monomials& monomials, int order, const Eigen::MatrixXd& offsets,
                        const Eigen::MatrixXd& values, Eigen::Index k, double radius) {
    const Eigen::Index n = offsets.cols(), count = monomials.count(order), r = values.cols();
    if (k < count + 2 || !(radius > 0.0)) return false;
    order_ = order;
    scaled_.resize(k, n);
    scaled_ = offsets.topRows(k) / radius;
    weight_.resize(k);
    weight_ = (1.0 - scaled_.rowwise().squaredNorm().array()).max(0.0).matrix();
    design_.resize(k, count);
    monomials.evaluate_columns(scaled_.data(), k, count, design_.data());
    for (Eigen::Index c = 0; c < count; ++c)
        design_.col(c).array() *= weight_.array();
    response_.resize(k, r);
    for (Eigen::Index c = 0; c < r; ++c)
        response_.col(c) = values.col(c).head(k).cwiseProduct(weight_);

    const double total = weight_.squaredNorm();
    double spread = 0.0;
    for (Eigen::Index c = 0; c < r; ++c) {
        const double mean = weight_.dot(response_.col(c)) / total;
        spread += (response_.col(c) - mean * weight_).squaredNorm();
    }
    spread_ = std::sqrt(spread / (total * static_cast<double>(r)));

    if (!orthogonalise()) return false;
    projection_.setZero(count, r);
    for (Eigen::Index d = 0; d < r; ++d)
        take_out(design_.data(), static_cast<std::size_t>(count), static_cast<std::size_t>(k), response_.col(d).data(),
                 projection_.col(d).data());
    coefficients_ = projection_;
    models::solve_upper_in_place(triangle_, coefficients_);
    if (!coefficients_.allFinite()) return false;

    const double freedom = static_cast<double>(k - count) / static_cast<double>(k);
    residual_ = std::sqrt(response_.squaredNorm() / (total * freedom * static_cast<double>(r)));
    predict_left_out(total);
    return std::isfinite(left_out_);
}

bool PolynomialFit::orthogonalise() {
    const Eigen::Index count = design_.cols();
    triangle_.setZero(count, count);
    const auto rows = static_cast<std::size_t>(design_.rows());
    for (Eigen::Index c = 0; c < count; ++c) {
        auto column = design_.col(c);
        const double before = column.norm();
        double left = before;
        // Twice is enough: the second round restores the orthogonality that near dependence costs.
        for (int round = 0; round < 2 && (round == 0 || left < 0.1 * before); ++round) {
            take_out(design_.data(), static_cast<std::size_t>(c), rows, column.data(), triangle_.col(c).data());
            left = column.norm();
        }
        if (!(left > lost_column * before)) return false;
        triangle_(c, c) = left;
        column /= left;
    }
    return true;
}

void PolynomialFit::predict_left_out(double total) {
    const Eigen::Index k = design_.rows(), count = design_.cols(), r = response_.cols();
    // The value at the origin is the first coefficient, e_1^T R^-1 Q^T W y.
    influence_ = Eigen::VectorXd::Unit(count, 0);
    models::solve_transposed_upper_in_place(triangle_, influence_);
    share_.setZero(k);
    value_influence_.setZero(k);
    for (Eigen::Index c = 0; c < count; ++c) {
        share_ += design_.col(c).array().square();
        value_influence_ += influence_[c] * design_.col(c).array();
    }
    leverage_ = (value_influence_ * weight_.array()).square().sum();
    double left_out = 0.0;
    for (Eigen::Index d = 0; d < r; ++d)
        left_out += (response_.col(d).array() / (1.0 - share_.min(largest_share))).square().sum();
    left_out_ = std::sqrt(left_out / (total * static_cast<double>(r)));
}

void PolynomialFit::part_residuals(const Monomials& monomials) {
    const Eigen::Index k = design_.rows(), count = design_.cols(), r = response_.cols();
    const Eigen::Index next = monomials.count(order_ + 1), all = monomials.count(order_ + 2), extra = all - count;
    columns_.resize(k, all);
    monomials.evaluate_columns(scaled_.data(), k, all, columns_.data());
    Eigen::MatrixXd columns = columns_.rightCols(extra);
    columns.rightCols(all - next) *= second_order_share;
    for (Eigen::Index c = 0; c < extra; ++c)
        columns.col(c).array() *= weight_.array();
    const auto rows = static_cast<std::size_t>(k);
    Eigen::MatrixXd onto = Eigen::MatrixXd::Zero(count, extra);
    for (Eigen::Index c = 0; c < extra; ++c)
        take_out(design_.data(), static_cast<std::size_t>(count), rows, columns.col(c).data(), onto.col(c).data());
    remainder_response_ = onto;
    models::solve_upper_in_place(triangle_, remainder_response_);
    const double smooth_share = columns.squaredNorm();

    // Independent errors of equal size per row: weighted, they are no longer equal. What a projection 1 - P leaves of
    // them is tr W (1 - P) W.
    const Eigen::ArrayXd weight2 = weight_.array().square();
    const double fit_share = (weight2 * (1.0 - share_)).sum();
    const Eigen::MatrixXd left = response_.transpose() * response_;
    independent_ = left / fit_share;
    remainder_ = smooth_share > 0.0 ? Eigen::MatrixXd(left / smooth_share) : Eigen::MatrixXd::Zero(r, r);
    for (Eigen::Index a = 0; a < r; ++a)
        for (Eigen::Index b = 0; b < r; ++b)
            if (a != b) remainder_(a, b) *= believed_correlation;
    if (k < all + extra) return;

    rest_ = response_;
    double explained_share = 0.0;  // of independent errors by the columns
    Eigen::VectorXd shares(std::max(extra, r));
    for (Eigen::Index c = 0; c < extra; ++c) {
        auto column = columns.col(c);
        const double before = column.norm();
        take_out(columns.data(), static_cast<std::size_t>(c), rows, column.data(), shares.data());
        const double norm = column.norm();
        if (!(norm > lost_column * before) || !(norm > 0.0)) return;
        column /= norm;
        for (Eigen::Index d = 0; d < r; ++d)
            take_out(column.data(), 1, rows, rest_.col(d).data(), shares.data());
        explained_share += (weight2 * column.array().square()).sum();
    }
    const Eigen::MatrixXd unexplained = rest_.transpose() * rest_;
    independent_ = unexplained / (fit_share - explained_share);
    remainder_ = left - unexplained - explained_share * independent_;
    // The share of chance is known to about its square root only, and a combination of the columns must not come out
    // negative.
    const Eigen::VectorXd least = independent_.diagonal() * (explained_share / std::sqrt(static_cast<double>(extra)));
    for (Eigen::Index d = 0; d < r; ++d)
        remainder_(d, d) = std::max(remainder_(d, d), least[d]);
    for (Eigen::Index a = 0; a < r; ++a)
        for (Eigen::Index b = 0; b < r; ++b) {
            const double limit = believed_correlation * std::sqrt(remainder_(a, a) * remainder_(b, b));
            if (a != b) remainder_(a, b) = std::clamp(remainder_(a, b), -limit, limit);
        }
    remainder_ /= smooth_share;
}

double PolynomialFit::value_variance() const {
    return (independent_.trace() * leverage_ + remainder_.trace() * remainder_response_.row(0).squaredNorm()) /
           static_cast<double>(independent_.rows());
}

}  // namespace orbid::orbits

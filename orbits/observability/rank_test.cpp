#include "orbits/observability/rank_test.hpp"

#include <algorithm>
#include <cmath>

#include "models/arithmetic/orthogonal_factor.hpp"
#include "models/arithmetic/singular_values.hpp"

namespace orbid::orbits {

namespace {

/// A column this small beside its own terms is nothing but their rounding.
constexpr double rounding = 1e-12;

Eigen::VectorXd own_lengths(const Eigen::MatrixXd& matrix, const Eigen::MatrixXd& terms) {
    return column_lengths(matrix.colwise().squaredNorm().transpose(), terms.colwise().squaredNorm().transpose());
}

/// How many of the smallest singular values are no effect: those below the widest gap, if it is clear and they are
/// small. A column too many counts as well.
Eigen::Index without_effect(const Eigen::VectorXd& values, Eigen::Index columns) {
    constexpr double clear_gap = 1e3;
    // What rounding leaves of nothing; the ratio of two such values says nothing.
    constexpr double least = 1e-15;
    Eigen::Index rank = values.size();
    double widest = clear_gap;
    for (Eigen::Index k = 0; k < values.size(); ++k) {
        if (!(values[k] < no_effect)) continue;
        const double above = k == 0 ? 1.0 : std::max(values[k - 1], least);
        const double gap = above / std::max(values[k], least);
        if (!(gap > widest)) continue;
        widest = gap;
        rank = k;
    }
    return columns - rank;
}

/// The upper triangle of a QR decomposition, all that later rows need to know.
Eigen::MatrixXd triangle(Eigen::MatrixXd rows) {
    models::householder_in_place(rows);
    const Eigen::Index count = std::min(rows.rows(), rows.cols());
    return rows.topRows(count).triangularView<Eigen::Upper>();
}

}  // namespace

Eigen::VectorXd column_lengths(const Eigen::VectorXd& squares, const Eigen::VectorXd& terms_squares) {
    Eigen::VectorXd lengths(squares.size());
    for (Eigen::Index j = 0; j < lengths.size(); ++j) {
        const double own = std::sqrt(squares[j]), terms = std::sqrt(terms_squares[j]);
        lengths[j] = own > rounding * terms ? own : terms > 0.0 ? terms : 1.0;
    }
    return lengths;
}

RankTest::RankTest(Eigen::Index shared)
    : information_(0, shared),
      square_(Eigen::VectorXd::Zero(shared)),
      terms_square_(Eigen::VectorXd::Zero(shared)),
      known_(static_cast<std::size_t>(shared), false) {}

Eigen::Index RankTest::add(const Eigen::MatrixXd& by_own, const Eigen::MatrixXd& by_shared,
                           const Eigen::MatrixXd& own_terms, const Eigen::MatrixXd& shared_terms) {
    Eigen::MatrixXd rows = by_shared;
    if (by_own.cols() > 0) models::HouseholderFactor(by_own).apply_transposed_q(rows);
    const Eigen::Index left = std::max<Eigen::Index>(rows.rows() - by_own.cols(), 0);
    Eigen::MatrixXd all(information_.rows() + left, information_.cols());
    all << information_, rows.bottomRows(left);
    information_ = triangle(std::move(all));
    square_ += by_shared.colwise().squaredNorm().transpose();
    terms_square_ += shared_terms.colwise().squaredNorm().transpose();
    return null_space(by_own, own_terms).cols();
}

void RankTest::know(Eigen::Index shared) {
    known_[static_cast<std::size_t>(shared)] = true;
}

Eigen::VectorXd RankTest::lengths() const {
    return column_lengths(square_, terms_square_);
}

Eigen::MatrixXd RankTest::scaled() const {
    const Eigen::Index count = information_.cols();
    Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(information_.rows() + count, count);
    rows.topRows(information_.rows()) = information_ * lengths().cwiseInverse().asDiagonal();
    for (Eigen::Index j = 0; j < count; ++j)
        if (known_[static_cast<std::size_t>(j)]) rows(information_.rows() + j, j) = 1.0;
    return rows;
}

Eigen::VectorXd RankTest::singular_values() const {
    return information_.cols() == 0 ? Eigen::VectorXd() : models::singular_values(scaled());
}

Eigen::MatrixXd RankTest::null_directions() const {
    if (information_.cols() == 0) return {};
    const models::SingularValues svd = models::singular_value_decomposition(scaled(), models::SingularVectors::right);
    const Eigen::Index count = without_effect(svd.values, information_.cols());
    return lengths().cwiseInverse().asDiagonal() * svd.v.rightCols(count);
}

Eigen::MatrixXd null_space(const Eigen::MatrixXd& matrix, const Eigen::MatrixXd& terms) {
    if (matrix.cols() == 0) return {};
    const Eigen::VectorXd inverse = own_lengths(matrix, terms).cwiseInverse();
    const models::SingularValues svd =
        models::singular_value_decomposition(matrix * inverse.asDiagonal(), models::SingularVectors::right);
    const Eigen::Index count = without_effect(svd.values, matrix.cols());
    return inverse.asDiagonal() * svd.v.rightCols(count);
}

Eigen::VectorXd compensation(const Eigen::MatrixXd& by_own, const Eigen::MatrixXd& by_shared,
                             const Eigen::MatrixXd& own_terms, const Eigen::VectorXd& direction) {
    if (by_own.cols() == 0) return {};
    const Eigen::VectorXd inverse = own_lengths(by_own, own_terms).cwiseInverse();
    models::CompleteFactor factor;
    factor.compute(by_own * inverse.asDiagonal(), no_effect);
    return -inverse.cwiseProduct(factor.solve(Eigen::VectorXd(by_shared * direction)));
}

}  // namespace orbid::orbits

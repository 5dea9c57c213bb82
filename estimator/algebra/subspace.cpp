#include "estimator/algebra/subspace.hpp"

#include <cmath>

#include "models/arithmetic/singular_values.hpp"
#include "models/arithmetic/triangular_solve.hpp"

namespace orbid::estimator {

namespace {

/// Whether no singular value of an upper triangle with unit columns is below a fraction of the largest. The least is at
/// least 1 / ||R^-1||, the largest at most the norm of R, the root of its columns.
bool far_from_singular(const Eigen::MatrixXd& r, double fraction) {
    const Eigen::Index q = r.cols();
    if (r.rows() != q || !r.isUpperTriangular(0.0) || !(r.diagonal().cwiseAbs().minCoeff() > 0.0)) return false;
    Eigen::MatrixXd inverse = Eigen::MatrixXd::Identity(q, q);
    models::solve_upper_in_place(r, inverse);
    return inverse.norm() * fraction * std::sqrt(static_cast<double>(q)) < 1.0;
}

}  // namespace

Eigen::MatrixXd Subspace::decided() const {
    Eigen::MatrixXd basis(unit.size(), data.cols() + prior.cols());
    basis << data, prior;
    return unit.cwiseInverse().asDiagonal() * basis;
}

Subspace split(const Eigen::MatrixXd& r, const Eigen::MatrixXd& prior, const Eigen::VectorXd& fallback,
               double tolerance) {
    const Eigen::Index q = r.cols();
    Subspace space;
    space.unit = r.colwise().norm().transpose();
    for (Eigen::Index i = 0; i < q; ++i)
        if (!(space.unit[i] > 0.0)) {
            const double own = prior.rows() > 0 ? prior.col(i).norm() : 0.0;
            space.unit[i] = own > 0.0 ? own : 1.0 / fallback[i];
        }
    space.data.resize(q, 0);
    space.prior.resize(q, 0);
    space.flat.resize(q, 0);
    space.rows.resize(r.rows(), 0);
    if (q == 0) return space;
    const Eigen::MatrixXd equilibrated = r * space.unit.cwiseInverse().asDiagonal();
    if (far_from_singular(equilibrated, tolerance)) {
        space.data.setIdentity(q, q);
        space.rows = equilibrated;
        return space;
    }
    const models::SingularValues svd =
        models::singular_value_decomposition(equilibrated, models::SingularVectors::full);
    Eigen::Index rank = 0;
    while (rank < q && svd.values[rank] > tolerance * svd.values[0])
        ++rank;
    space.data = svd.v.leftCols(rank);
    space.rows = svd.u.leftCols(rank) * svd.values.head(rank).asDiagonal();
    const Eigen::MatrixXd null = svd.v.rightCols(q - rank);
    if (null.cols() == 0) return space;
    if (prior.rows() == 0) {
        space.flat = null;
        return space;
    }
    const Eigen::MatrixXd prior_rows = prior * space.unit.cwiseInverse().asDiagonal() * null;
    const models::SingularValues prior_svd =
        models::singular_value_decomposition(prior_rows, models::SingularVectors::right);
    const Eigen::VectorXd& values = prior_svd.values;
    // The prior is known exactly; only rounding has to be distinguished from curvature here.
    constexpr double prior_tolerance = 1e-9;
    Eigen::Index prior_rank = 0;
    while (prior_rank < values.size() && values[prior_rank] > prior_tolerance * values[0])
        ++prior_rank;
    space.prior = null * prior_svd.v.leftCols(prior_rank);
    space.flat = null * prior_svd.v.rightCols(null.cols() - prior_rank);
    return space;
}

}  // namespace orbid::estimator

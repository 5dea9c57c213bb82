#include "estimator/algebra/subspace.hpp"

#include <cmath>

#include <Eigen/SVD>

namespace orbid::estimator {

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
    space.left.resize(r.rows(), 0);
    space.singular_values.resize(q);
    if (q == 0) return space;
    const Eigen::MatrixXd equilibrated = r * space.unit.cwiseInverse().asDiagonal();
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(equilibrated, Eigen::ComputeFullU | Eigen::ComputeFullV);
    space.singular_values = svd.singularValues();
    Eigen::Index rank = 0;
    while (rank < q && space.singular_values[rank] > tolerance * space.singular_values[0])
        ++rank;
    space.data = svd.matrixV().leftCols(rank);
    space.left = svd.matrixU().leftCols(rank);
    const Eigen::MatrixXd null = svd.matrixV().rightCols(q - rank);
    if (null.cols() == 0) return space;
    if (prior.rows() == 0) {
        space.flat = null;
        return space;
    }
    const Eigen::MatrixXd prior_rows = prior * space.unit.cwiseInverse().asDiagonal() * null;
    const Eigen::JacobiSVD<Eigen::MatrixXd> prior_svd(prior_rows, Eigen::ComputeFullV);
    const Eigen::VectorXd& values = prior_svd.singularValues();
    // The prior is known exactly; only rounding has to be told from curvature here.
    constexpr double prior_tolerance = 1e-9;
    Eigen::Index prior_rank = 0;
    while (prior_rank < values.size() && values[prior_rank] > prior_tolerance * values[0])
        ++prior_rank;
    space.prior = null * prior_svd.matrixV().leftCols(prior_rank);
    space.flat = null * prior_svd.matrixV().rightCols(null.cols() - prior_rank);
    return space;
}

}  // namespace orbid::estimator

#include "orbits/local_maps/local_polynomial.hpp"

#include "models/arithmetic/orthogonal_factor.hpp"
#include "models/arithmetic/triangular_solve.hpp"
#include "orbits/local_maps/monomials.hpp"

namespace orbid::orbits {
namespace {

// Ratio of diagonal entries of the triangular factor below which the points have fewer dimensions than the place.
constexpr double lost_dimension = 1e-9;

}  // namespace

LocalPolynomial fit_local_polynomial(const Eigen::MatrixXd& offsets, const Eigen::MatrixXd& values, double radius,
                                     int order, double blur) {
    const Eigen::Index k = offsets.rows(), n = offsets.cols(), coefficients = coefficient_count(n, order);
    LocalPolynomial result;
    if (k < coefficients + 2 || !(radius > 0.0)) return result;
    const Eigen::MatrixXd t = offsets / radius;
    Eigen::MatrixXd design(k, coefficients);
    // Columns: what value and slope are made of the coefficients.
    Eigen::MatrixXd parts = Eigen::MatrixXd::Identity(coefficients, n + 1);
    const double smeared = blur / (radius * radius);
    Eigen::Index column = 0;
    design.col(column++).setOnes();
    for (Eigen::Index a = 0; a < n; ++a)
        design.col(column++) = t.col(a);
    for (Eigen::Index a = 0; order > 1 && a < n; ++a)
        for (Eigen::Index b = a; b < n; ++b) {
            if (a == b) parts(column, 0) = -smeared;
            design.col(column++) = t.col(a).cwiseProduct(t.col(b));
        }
    for (Eigen::Index a = 0; order > 2 && a < n; ++a)
        for (Eigen::Index b = a; b < n; ++b)
            for (Eigen::Index c = b; c < n; ++c) {
                if (a == b && b == c)
                    parts(column, 1 + a) = -3.0 * smeared;
                else if (a == b)
                    parts(column, 1 + c) = -smeared;
                else if (b == c)
                    parts(column, 1 + a) = -smeared;
                design.col(column++) = t.col(a).cwiseProduct(t.col(b)).cwiseProduct(t.col(c));
            }
    const Eigen::VectorXd weight = (1.0 - t.rowwise().squaredNorm().array()).matrix();
    const Eigen::RowVectorXd mean = values.colwise().mean();
    const Eigen::MatrixXd right = weight.asDiagonal() * (values.rowwise() - mean);
    const models::PivotedFactor solver(weight.asDiagonal() * design, lost_dimension);
    if (solver.rank() < coefficients) return result;
    const Eigen::MatrixXd solution = solver.solve(right);
    const Eigen::MatrixXd left = right - weight.asDiagonal() * (design * solution);
    const double freedom = 1.0 - static_cast<double>(coefficients) / static_cast<double>(k);
    result.residual = left.transpose() * left / (weight.squaredNorm() * freedom);
    // Weights of the single values in these: columns of Q R'^-1 P' parts.
    Eigen::MatrixXd first = solver.permuted_back(parts);
    models::solve_transposed_upper_in_place(solver.packed().topLeftCorner(coefficients, coefficients), first);
    Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(k, n + 1);
    rows.topRows(coefficients) = first;
    solver.apply_q(rows);
    rows = weight.asDiagonal() * rows;
    const Eigen::VectorXd leverages = rows.colwise().squaredNorm().transpose();
    result.weights = rows.col(0);
    result.leverage = leverages[0];
    result.slope_leverage = leverages.tail(n) / (radius * radius);
    const Eigen::MatrixXd told = parts.transpose() * solution;
    result.value = (mean + told.row(0)).transpose();
    result.slope = told.bottomRows(n).transpose() / radius;
    result.usable = result.value.allFinite() && result.slope.allFinite() && result.residual.allFinite();
    return result;
}

}  // namespace orbid::orbits

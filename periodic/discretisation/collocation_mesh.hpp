#pragma once

#include <vector>

#include "periodic/discretisation/gauss_method.hpp"
#include "periodic/discretisation/gauss_steps.hpp"
#include "periodic/orbit/eigen_names.hpp"

namespace orbid::periodic {

/// A solution by collocation on a mesh, as piecewise polynomials.
struct PiecewisePolynomial {
    std::vector<double> mesh;      ///< shares of the orbit at which intervals begin
    MatrixXd nodes;                ///< shape (n, N): states there, angles continuous
    std::vector<MatrixXd> slopes;  ///< dx/ds at the collocation points, shape (n, m) each

    /// States at ascending shares in [0, 1), shape (n, shares.size()).
    [[nodiscard]] MatrixXd at(const std::vector<double>& shares, const GaussMethod& method) const;
};

/// Empty slopes where the equations of an interval cannot be solved.
[[nodiscard]] PiecewisePolynomial piecewise_polynomial(const GaussSteps& steps, const MatrixXd& nodes, double time);

/// A mesh of equally many intervals, each with the same share of the integral of |x^(m+1)|^(1/(m+1)). That derivative
/// is estimated from the jumps of the m-th between intervals.
///
/// @param scale  typical size of each coordinate.
[[nodiscard]] std::vector<double> equidistributed(const PiecewisePolynomial& solution, const GaussMethod& method,
                                                  const VectorXd& scale);

/// Every interval halved.
[[nodiscard]] std::vector<double> halved(const std::vector<double>& mesh);

}  // namespace orbid::periodic

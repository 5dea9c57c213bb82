#pragma once

#include <vector>

#include "tests/estimator/minimisation/least_squares_problem.hpp"

namespace orbid::bench {

/// What a least-squares code found.
struct Solution {
    std::vector<double> x;
    bool converged = false;
    int iterations = 0;
    double seconds = 0.0;  ///< of the whole call
};

/// Where a solver starts and may go; empty bounds = none.
struct Task {
    std::vector<double> start;
    std::vector<double> lower;
    std::vector<double> upper;
};

/// The peer: Ceres with its default trust region (Levenberg-Marquardt) and DENSE_QR.
///
/// Each part of the problem (see LeastSquares) is one residual block: the cost function is the same function that the
/// estimator calls, and writes straight into the arrays of either, so that neither side pays for the other's
/// derivatives. Tolerances: function 1e-16, gradient 1e-16, parameters 1e-14; with the defaults (1e-6, 1e-10, 1e-8)
/// Ceres is faster and solves fewer of the NIST problems to four digits.
[[nodiscard]] Solution solve_with_ceres(const std::vector<tests::LeastSquares>& parts, const Task& task, int threads);

}  // namespace orbid::bench

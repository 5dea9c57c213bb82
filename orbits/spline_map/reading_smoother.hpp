#pragma once

#include <cstddef>
#include <vector>

#include <Eigen/Core>

namespace orbid::orbits {

/// Small matrices and vectors without heap memory: at most 4 coordinates.
using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, 4, 4>;
using SmallVector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, 4, 1>;

/// One step of a series under a map, linearised.
struct SeriesStep {
    bool present = false;  ///< the point has an image
    SmallVector residual;  ///< r = y' - F(x) - A (y - x), shape (n)
    SmallMatrix jacobian;  ///< A, shape (n, n)
    SmallMatrix model;     ///< Q, shape (n, n): covariance of the map's error
};

/// Errors in both sides of y' = F(y): with independent reading errors e of covariance S the residuals are
/// r_t = e_{t+1} - A_t e_t + (model error), of covariance
///
///     V_tt = Q_t + S + A_t S A_t',    V_{t,t+1} = -S A_{t+1}'
///
/// block-tridiagonal along every uninterrupted piece. This is its inverse, as far as needed.
class ReadingSmoother {
public:
    /// Steps whose residual, given the earlier ones, exceeds `gate` (chi-square per step) get a larger model
    /// covariance, until the residual is at the gate. They then no longer distort the fit.
    ReadingSmoother(std::vector<SeriesStep> steps, const Eigen::MatrixXd& reading_covariance, double gate);

    [[nodiscard]] const std::vector<SeriesStep>& steps() const { return steps_; }
    [[nodiscard]] std::size_t gated() const { return gated_; }

    /// V^-1 r, shape (n, steps), 0 where there is no step.
    [[nodiscard]] Eigen::MatrixXd weighted(const Eigen::MatrixXd& residuals) const;
    /// Most probable reading errors, shape (n, steps), from u = V^-1 r:  e_t = S (u_{t-1} - A_t' u_t).
    [[nodiscard]] Eigen::MatrixXd reading_errors(const Eigen::MatrixXd& weighted) const;
    /// Covariance of what remains unknown of the reading error of point t.
    [[nodiscard]] SmallMatrix remaining_covariance(std::size_t t) const;

    [[nodiscard]] const SmallMatrix& inverse_diagonal(std::size_t t) const { return diagonal_[t]; }  ///< (V^-1)_tt
    /// Blocks (V^-1)_{t,t+k} for k = 0, 1, ... until they are negligible (or the piece ends), first into `row`.
    void inverse_row(std::size_t t, std::vector<SmallMatrix>& row) const;

private:
    [[nodiscard]] bool linked(std::size_t t) const {  // steps t and t + 1 share a reading
        return t + 1 < steps_.size() && steps_[t].present && steps_[t + 1].present;
    }

    std::vector<SeriesStep> steps_;
    SmallMatrix reading_;
    std::vector<SmallMatrix> coupling_;  ///< V_{t,t+1}
    std::vector<SmallMatrix> forward_;   ///< inverse of V_tt reduced by all steps before
    std::vector<SmallMatrix> backward_;  ///< the same by all steps after
    std::vector<SmallMatrix> diagonal_;  ///< (V^-1)_tt
    std::size_t gated_ = 0;
};

}  // namespace orbid::orbits

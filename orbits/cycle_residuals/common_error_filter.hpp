#pragma once

#include <vector>

#include <Eigen/Core>

namespace orbid::orbits {

/// Errors e_b = G_b u + own error, with one vector u ~ N(0, 1) shared by all blocks and own errors ~ N(0, R_b): their
/// joint density as a product of one factor per block,
///
///     p(e_1, e_2, ..) = prod_b N(e_b - G_b m_b; 0, S_b),    S_b = R_b + G_b P_b G_b'
///
/// where m_b and P_b are mean and covariance of u given the blocks before b (Kalman's filter for a state that does not
/// move). So blocks that depend on each other are what the estimator takes them for: independent. The gains do not
/// depend on the errors.
///
/// Source: Anderson, Moore, Optimal Filtering (1979), innovations. Cost of the filter: blocks x columns^2, once; of a
/// set of errors: records x columns.
struct CommonErrorStep {
    Eigen::MatrixXd shape;  ///< S_b, shape (records, records)
    Eigen::MatrixXd gain;   ///< K_b = P_b G_b' S_b^-1, shape (columns, records); what e_b tells about u
};

class CommonErrorFilter {
public:
    /// @param columns  of G.
    explicit CommonErrorFilter(Eigen::Index columns) : left_(Eigen::MatrixXd::Identity(columns, columns)) {}

    /// The next block. @param common  G_b, shape (records, columns). @param own  R_b, so that S_b is positive definite.
    /// @param told  false: the block's errors tell nothing about those of later ones (it does not take part).
    [[nodiscard]] CommonErrorStep next(const Eigen::MatrixXd& common, const Eigen::MatrixXd& own, bool told);

private:
    Eigen::MatrixXd left_;  ///< P_b
};

/// Innovations of a sequence of errors, and of their derivatives: the columns of e are treated alike.
class CommonErrorMean {
public:
    /// @param width  columns of each e.
    CommonErrorMean(Eigen::Index columns, Eigen::Index width) : mean_(Eigen::MatrixXd::Zero(columns, width)) {}

    /// e_b - G_b m_b in place.
    void take_from(const Eigen::MatrixXd& common, Eigen::MatrixXd& e) const { e -= common * mean_; }
    /// What the innovations of a block tell about u.
    void learn(const Eigen::Ref<const Eigen::MatrixXd>& gain, const Eigen::MatrixXd& innovation) {
        mean_ += gain * innovation;
    }

private:
    Eigen::MatrixXd mean_;  ///< m_b
};

}  // namespace orbid::orbits

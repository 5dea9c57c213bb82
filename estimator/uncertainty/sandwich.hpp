#pragma once

#include <vector>

#include <Eigen/Core>

#include "estimator/problem/block_set.hpp"
#include "estimator/problem/linearisation.hpp"

namespace orbid::estimator {

/// Covariance of the determined parameters from the scatter of cluster scores, not from assumed independence.
///
///     C = R^-1 [ sum_c S_c S_c^T ] R^-T,    S_c = theta part of (I - Q_c^T Q_c)^(-1/2) Q_c^T w_c
///
/// Q = orthonormal columns of the whitened sensitivities (latent states included, so that scores are projected on their
/// complement), w = whitened residuals, c = clusters. The root corrects the shrinkage of residuals within a cluster by
/// the fit (Bell and McCaffrey's bias-reduced linearisation, CR2).
class Sandwich {
public:
    /// @param rows      one BlockRows per active block, NOT compressed, columns in the basis of determined directions.
    /// @param cluster   per active block, cluster number (from 0, within the block) of each record.
    /// @param triangle  R of the determined parameters with prior, shape (rank, rank).
    Sandwich(const std::vector<BlockRows>& rows, const BlockSet& set, const std::vector<std::vector<int>>& cluster,
             const std::vector<NoiseModel>& laws, const Eigen::VectorXd& psi, const Eigen::MatrixXd& triangle);

    [[nodiscard]] const Eigen::MatrixXd& covariance() const { return covariance_; }  ///< shape (rank, rank)
    [[nodiscard]] std::size_t clusters() const { return parts_.size(); }
    /// Degrees of freedom of the variance of direction^T y (Satterthwaite, errors equal and independent as reference):
    /// about the number of clusters that matter for it, less the parameters; at least 1.
    [[nodiscard]] double degrees_of_freedom(const Eigen::VectorXd& direction) const;

private:
    struct Part {
        std::size_t block;
        Eigen::MatrixXd gram;  ///< Q_c^T Q_c
        Eigen::MatrixXd root;  ///< (I - gram)^(-1/2)
    };
    Eigen::Index rank_;
    Eigen::MatrixXd triangle_;
    std::vector<Part> parts_;
    Eigen::MatrixXd covariance_;
};

}  // namespace orbid::estimator

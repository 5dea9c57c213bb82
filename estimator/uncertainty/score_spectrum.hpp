#pragma once

#include <vector>

#include <Eigen/Core>

namespace orbid::estimator {

/// What the scores of one block are made of. Rows are whitened records.
struct ScoreRows {
    /// Sensitivities to the determined parameters, less what latent states take of them, times R^-1; shape (rows, rank)
    Eigen::MatrixXd sensitivity;
    Eigen::MatrixXd latent;    ///< orthonormal sensitivities to latent states, shape (rows, latents); empty in chains
    Eigen::VectorXd residual;  ///< shape (rows)
    Eigen::VectorXd time;      ///< of each row on one axis for all blocks, in records, shape (rows)
};

/// Covariance of the determined parameters from the long-run variance of their scores, whatever the correlation.
///
///     S(t) = sensitivity^T residual,   L_j = sum_t cos(pi j t / T) S(t),   V = R^-1 [ sum_{j <= B} L_j L_j^T / E ]
///     R^-T
///
/// The B lowest frequencies see neither ringing nor the shape of the correlation, only its sum; E is what independent
/// errors of sd 1 would give for the same residuals of a fit, so that the variance is unbiased for them. With its B
/// degrees of freedom (Satterthwaite's, where few records decide) the t interval holds for a fixed B. B is the largest,
/// up to 21, over which an autoregression of 64 sums of scores says that the spectrum is flat to 6 per cent. One alone
/// is no variance.
///
/// Scores of records at the same time add up. Blocks follow each other on one axis; that neighbours across a border are
/// independent shows in the scores.
/// Source: Lazarus, Lewis, Stock and Watson, J. Business Econ. Statist. 36 (2018) 541 (equal-weighted cosines, t_B);
/// docs/errors_and_posterior.md compares it with kernels, prewhitening, Sokal's window and batch means.
class ScoreSpectrum {
public:
    /// @param length  T, end of the axis, in records.
    /// @param left    share of the residuals' variance that latent states leave where `latent` is empty, in (0, 1].
    ScoreSpectrum(std::vector<ScoreRows> blocks, double length, double left);

    /// The variance of one linear combination over that of independent errors.
    struct Ratio {
        double value = 1.0;
        double degrees_of_freedom = 0.0;  ///< >= 1
        Eigen::Index frequencies = 0;     ///< B
        bool enough = false;              ///< B is two or more
    };
    /// @param direction  coefficients of the sensitivities: of the combination a^T y it is R^-T a; not zero.
    [[nodiscard]] Ratio along(const Eigen::VectorXd& direction) const;
    /// 2 / B sum_j L_j L_j^T over more than rank frequencies (for correlations), shape (rank, rank).
    [[nodiscard]] Eigen::MatrixXd scatter() const;

private:
    [[nodiscard]] Eigen::Index most() const;
    [[nodiscard]] Eigen::MatrixXd cosines(const ScoreRows& block, Eigen::Index first, Eigen::Index count,
                                          Eigen::Index frequencies) const;

    std::vector<ScoreRows> blocks_;
    double length_;
    double left_;
    Eigen::Index rank_ = 0;
    Eigen::MatrixXd binned_;  ///< scores, shape (rank, bins)
};

}  // namespace orbid::estimator

#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/residual.hpp"

namespace orbid::estimator {

/// One error parameter in its coordinate psi.
struct ErrorCoordinate {
    enum class Kind { log, fisher, linear };  ///< psi = ln x, atanh x, x
    std::string name;                         ///< "scale", "dof", "relative", "correlation", "covariance"
    Kind kind = Kind::log;
    bool estimate = true;
    double start = 0.0;  ///< natural; <= 0 for an estimated scale: start from the residuals
    Prior prior = FlatPrior{};
    double lower;  ///< limits in psi: dof >= 1 ... 1e4, relative >= 1e-9, |correlation| <= 1 - 1e-9; else infinite
    double upper;

    [[nodiscard]] double natural(double psi) const;
    [[nodiscard]] double at(double natural) const;
    [[nodiscard]] double slope(double psi) const;  ///< d natural / d psi
    /// A scale that is to be taken from the first residuals.
    [[nodiscard]] bool start_unknown() const { return kind == Kind::log && !(start > 0.0); }
};

/// The errors of one channel, or of several responses with a full covariance: records that must be treated together.
///
/// The errors e of a lognormal law are ln y - ln yhat and its rows a = de/dx = -dyhat/dx / yhat in every function
/// below; the caller transforms them. All other laws take e = y - yhat.
///
/// Error parameters in their coordinates psi, in this order:
///     normal, laplace, lognormal  ln s                student_t  ln s, ln dof
///     relative  ln s, ln relative                     autoregressive  ln s, atanh correlation
///     joint     the lower triangle of L in V = L L^T, column by column, ln of the diagonal entries
struct NoiseModel {
    ErrorDistribution distribution = NormalErrors{};
    std::vector<int> channels;                 ///< one, or the m responses of a full covariance
    std::vector<ErrorCoordinate> coordinates;  ///< shape (number of error parameters)
    Eigen::Index first = 0;                    ///< of its parameters in the psi of the whole estimate
    bool slack = false;                        ///< Group::slack with a fixed scale
    /// Of Student's density with a fixed dof, see error_density.hpp; computed here once, not in every block.
    std::optional<double> normalisation{};
    double inverse_wishart_dof = 0.0;  ///< see JointCovariance
    Eigen::MatrixXd inverse_wishart_psi;

    [[nodiscard]] bool joint() const { return channels.size() > 1; }
    [[nodiscard]] Eigen::Index size() const { return static_cast<Eigen::Index>(coordinates.size()); }
    /// Whether the psi of the whole estimate with this index is one of its own.
    [[nodiscard]] bool has(Eigen::Index k) const { return k >= first && k < first + size(); }
    /// Its own part of the psi of the whole estimate.
    [[nodiscard]] Eigen::VectorXd own(const Eigen::VectorXd& psi) const { return psi.segment(first, size()); }
    /// Records may be replaced by the R factor of their rows: the law depends on sums of squares only.
    [[nodiscard]] bool compressible() const;
    /// Fisher information of a record on ln s, where that alone divides the record: 2 of normal errors. Else 0.
    /// @param psi  of this law alone, shape (coordinates).
    [[nodiscard]] double scale_information(const Eigen::VectorXd& psi) const;
    /// Whether all of Curvature are the same: normal errors whose covariance does not depend on the prediction.
    [[nodiscard]] bool has_one_curvature() const;
    /// Whitened rows per record: relative errors have two, first all of the mean and then all of the variance.
    [[nodiscard]] int rows_per_record() const { return std::holds_alternative<RelativeErrors>(distribution) ? 2 : 1; }
    /// Its records need y: relative errors for the prediction y - e, lognormal ones for ln y.
    [[nodiscard]] bool needs_observed() const;
    /// The scale s of the law, or the root of V's diagonal entry. @param psi  of this law alone, shape (coordinates);
    /// @param channel  index into `channels`.
    [[nodiscard]] double scale(const Eigen::VectorXd& psi, std::size_t channel) const;
};

/// The laws of all groups of all residuals as their active sets have them, in the order of their first channel;
/// channels are numbered across residuals.
///
/// A group's floor is the lower limit of its ln s (of ln L_ii in a full covariance). The limits of an estimated
/// coordinate exclude where its prior is zero. V starts at diag(scale^2).
/// @throws std::invalid_argument naming the group. Values: dof < 1 or > 1e4, |correlation| >= 1, relative < 1e-9,
///         negative floor, a fixed scale <= 0, a start where its prior is zero. Covariances: a group in two of them or
///         one that does not exist; groups that are not normal, or whose scales are fixed or have priors;
///         inverse-Wishart with dof <= m - 1 or psi not positive definite. Also priors that are refused by validate(),
///         and sets of other residuals.
[[nodiscard]] std::vector<NoiseModel> error_laws(const std::vector<const Residual*>& residuals,
                                                 const std::vector<ActiveSet>& active);

/// Records of one law in one block: [A | e], records in order (several responses: one response after the other).
struct LawRecords {
    Eigen::MatrixXd rows;      ///< shape (rows, columns + 1), the last column is e
    Eigen::VectorXd observed;  ///< y, shape (count), empty unless the law needs it
    Eigen::Index count = 0;    ///< records; differs from rows when these are compressed
};

/// Which second derivative the whitened rows carry.
///
/// step: of the objective itself where it is positive, for fast steps. expected: the Fisher information, for
/// uncertainties and for ln|H| of (M9); of errors that are in truth zero the second derivative there. guarded: as
/// step, except for far outliers under Student's t. If a step would carry such a record beyond its mirror image, it
/// counts with its weight g / e, which always descends. This is for records that are to vanish rather than to scatter.
/// All are equal for normal errors with a fixed covariance.
enum class Curvature { step, expected, guarded };

/// Rows S with S^T S = second derivative and S_A^T s = gradient of -ln p with respect to the columns of A (s = last
/// column of S). Also the value of -ln p itself (with normalisation, without the prior of psi). For lognormal errors it
/// is the density of y where `observed` is given, of ln y otherwise.
///
/// Relative errors have two rows per record, the second ones after all first ones: their variance changes with the
/// prediction. Under Curvature::step the second rows are zero.
struct WhitenedRows {
    Eigen::MatrixXd rows;
    double value = 0.0;
};

/// @param psi  all error parameters of the law in their coordinates, shape (coordinates).
[[nodiscard]] WhitenedRows whitened_rows(const NoiseModel& law, const LawRecords& records, const Eigen::VectorXd& psi,
                                         Curvature curvature);

/// Their derivatives with respect to psi[j], exact to rounding: by dual numbers, so that no formula is written twice.
[[nodiscard]] WhitenedRows whitened_rows_slope(const NoiseModel& law, const LawRecords& records,
                                               const Eigen::VectorXd& psi, Eigen::Index j, Curvature curvature);

/// L of V = L L^T, shape (m, m), from the psi of the whole estimate.
[[nodiscard]] Eigen::MatrixXd covariance_root(const NoiseModel& law, const Eigen::VectorXd& psi);

/// The log-Cholesky coordinates of L, shape (m (m + 1) / 2); the inverse of covariance_root().
[[nodiscard]] Eigen::VectorXd root_coordinates(const Eigen::MatrixXd& lower);

/// d V / d psi, shape (m * m, m (m + 1) / 2): V column by column.
[[nodiscard]] Eigen::MatrixXd covariance_slopes(const NoiseModel& law, const Eigen::VectorXd& psi);

/// Value of -ln p at `next` minus value at e without the cancellation of two sums, or of two nearly equal squares.
/// @param e, next  errors of the law's records before and after, shape (records).
[[nodiscard]] double value_change(const NoiseModel& law, const Eigen::VectorXd& e, const Eigen::VectorXd& next,
                                  const Eigen::VectorXd& observed, const Eigen::VectorXd& psi);

/// Whitened errors: independent, mean 0 and sd 1 when the law is right (for diagnostics).
///
/// Student_t and laplace: normal score Phi^-1(F(e)), at most 37.5 in size. Autoregressive: innovations. Joint: L^-1 e,
/// in which response i is conditional on responses 0 ... i - 1. Shape (records).
[[nodiscard]] Eigen::VectorXd standard_errors(const NoiseModel& law, const Eigen::VectorXd& e,
                                              const Eigen::VectorXd& observed, const Eigen::VectorXd& psi);

/// -ln prior density of the law's estimated parameters in the coordinates psi (flat: no term; inverse-Wishart in V).
[[nodiscard]] double prior_term(const NoiseModel& law, const Eigen::VectorXd& psi);

/// Its derivative with respect to psi[j], by dual numbers.
[[nodiscard]] double prior_slope(const NoiseModel& law, const Eigen::VectorXd& psi, Eigen::Index j);

}  // namespace orbid::estimator

#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "estimator/prior.hpp"

namespace orbid::estimator {

/// The standard deviation of a group's errors, or the factor on a known covariance shape: s_g in (M8).
struct ErrorScale {
    bool estimate = true;
    double value =
        1.0;  ///< the value when fixed, the start when estimated (<= 0 while estimated: start from the residuals)
    Prior prior = FlatPrior{};
};

/// Records with a common error distribution (a "channel"): normal, V_g = s_g^2 W_g.
struct Group {
    std::string name;  ///< unique within an estimate, as shown in results: "cycles.phi"
    std::string unit;
    ErrorScale scale;
    bool factor = false;  ///< s_g is a factor on a covariance that the blocks bring (unit 1), not a sd in `unit`
    /// Consecutive records of this group within a block are equidistant samples in time: the estimator then looks at
    /// their autocorrelation. `interval` is the distance in `interval_unit`.
    bool ordered = false;
    double interval = 0.0;
    std::string interval_unit = "s";
};

enum class LatentStructure { none, independent_blocks };

/// A set of records that shares one vector of latent states (possibly of length 0), and one covariance shape.
struct BlockLayout {
    std::string label;       ///< "cycle 3", "run1, segment 0": names the block in messages and reports
    std::vector<int> group;  ///< group of each record, index into groups()
    /// Sigma_b, shape (records, records), symmetric positive definite: V_b = D Sigma_b D, D = diag(s_group(record)).
    /// Empty = identity (and never formed: blocks of 1e5 records are usual).
    Eigen::MatrixXd shape;
    Eigen::Index latents = 0;
    bool active = true;  ///< false: lost, suspended or rejected; takes no part, is counted
};

enum class BlockStatus { ok, failed };

/// e = y - yhat(theta, z) of one block in the unit of each record, with derivatives.
struct BlockValue {
    BlockStatus status = BlockStatus::ok;
    Eigen::VectorXd e;
    Eigen::MatrixXd e_theta;  ///< shape (records, parameters); empty when derivatives were not asked for
    Eigen::MatrixXd e_z;      ///< shape (records, latents)
};

/// What refresh() did to the set of blocks between two minimisations.
struct RefreshReport {
    bool changed = false;
    int lost = 0;      ///< blocks that can no longer be evaluated
    int rejected = 0;  ///< gross errors
    int added = 0;
};

/// A source of residuals. Knows models and data; the estimator knows neither.
/// Const functions are thread-safe. layout() does not change during a minimisation, only by refresh() or suspend().
class Residual {
public:
    virtual ~Residual() = default;

    [[nodiscard]] virtual std::string_view type() const = 0;  ///< "cycles", "series"
    [[nodiscard]] virtual const std::vector<Group>& groups() const = 0;
    [[nodiscard]] virtual const std::vector<BlockLayout>& layout() const = 0;
    [[nodiscard]] virtual LatentStructure structure() const = 0;
    /// One vector per block, of length layout()[b].latents.
    [[nodiscard]] virtual std::vector<Eigen::VectorXd> initial_latents() const = 0;
    /// Values of all ACTIVE blocks (others are left empty), theta in natural units, in the order of the estimate's
    /// parameters. A block that cannot be evaluated has status failed; nothing is thrown for that.
    [[nodiscard]] virtual std::vector<BlockValue> evaluate(const Eigen::VectorXd& theta,
                                                           const std::vector<Eigen::VectorXd>& latents,
                                                           bool derivatives) const = 0;
    /// Between two minimisations: gating, new starting solutions, matching. scales = current s_g of groups().
    virtual RefreshReport refresh(const Eigen::VectorXd& theta, const std::vector<Eigen::VectorXd>& latents,
                                  const Eigen::VectorXd& scales) = 0;
    /// Takes a block out (it stopped too many steps). Counted as lost.
    virtual void suspend(std::size_t block) = 0;

protected:
    Residual() = default;
    Residual(const Residual&) = default;
    Residual& operator=(const Residual&) = default;
};

}  // namespace orbid::estimator

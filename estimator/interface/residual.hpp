#pragma once

#include <cstddef>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/eigen_layout.hpp"
#include "estimator/interface/prior.hpp"

#pragma GCC visibility push(default)

namespace orbid::estimator {

/// The standard deviation of a group's errors, or the factor on a known covariance shape: s_g in (M8).
struct ErrorScale {
    bool estimate = true;
    double value =
        1.0;  ///< the value when fixed, the start when estimated (<= 0 while estimated: start from the residuals)
    Prior prior = FlatPrior{};
};

/// A parameter of an error distribution besides its scale.
struct ErrorParameter {
    bool estimate = true;
    double value = 0.0;  ///< the value when fixed, the start when estimated
    Prior prior = FlatPrior{};
};

/// How the errors of a group are distributed; s is the group's ErrorScale. The density of one record is
///
///     normal          exp(-(e/s)^2 / 2) / (s sqrt(2 pi))
///     student_t       Student's t with `dof` >= 1 and scale s; sd s sqrt(dof / (dof - 2)) for dof > 2
///     laplace         hyperbolic, exp(-sqrt(e^2 + d^2) / s), d = s / 100: Laplace's with its cusp rounded
///     lognormal       ln y - ln yhat normal with sd s (no unit); needs BlockLayout::observed
///     relative        normal with variance s^2 + (relative yhat)^2; needs BlockLayout::observed
///     autoregressive  stationary first-order autoregression of sd s within each block, in the order of the records:
///                     e_t = correlation e_{t-1} + innovation
struct NormalErrors {};
struct StudentErrors {
    ErrorParameter dof{false, 4.0, FlatPrior{}};
};
struct LaplaceErrors {};
struct LogNormalErrors {};
struct RelativeErrors {
    ErrorParameter relative{true, 0.05, FlatPrior{}};
};
struct AutoregressiveErrors {
    ErrorParameter correlation{true, 0.0, FlatPrior{}};  ///< in (-1, 1)
};
using ErrorDistribution =
    std::variant<NormalErrors, StudentErrors, LaplaceErrors, LogNormalErrors, RelativeErrors, AutoregressiveErrors>;

/// Normal errors of several responses with one full covariance V (m x m): the k-th records of the groups in a block
/// belong together. V is estimated, starting from the groups' own scales.
struct JointCovariance {
    std::vector<int> groups;  ///< two or more, each with the same number of records in every block, normal
    /// Inverse-Wishart prior with `dof` > m - 1 and matrix `psi`; dof = 0: none. Its density is taken in V itself, so
    /// that the mode is (psi + M) / (n + dof + m + 1).
    double dof = 0.0;
    Eigen::MatrixXd psi;
};

/// Records with a common error distribution (a "channel"): V_g = s_g^2 W_g for normal errors.
struct Group {
    std::string name;  ///< unique within an estimate, as shown in results: "cycles.phi"
    std::string unit;
    ErrorScale scale;
    ErrorDistribution distribution = NormalErrors{};
    double floor = 0.0;   ///< least value of an estimated scale, >= 0: errors are known not to be smaller
    bool factor = false;  ///< s_g is a factor on the blocks' own covariance (unit 1), not a sd in `unit`
    /// The errors are in truth zero, and the scale only says how far the computation may leave them: while it is fixed,
    /// or estimated and at its floor. Such records hold parameters, but their scale does not count as an error of them.
    bool slack = false;
    /// Consecutive records of this group within a block are equidistant samples in time: the estimator then computes
    /// their autocorrelation. `interval` is the distance in `interval_unit`.
    bool ordered = false;
    double interval = 0.0;
    std::string interval_unit = "s";
};

/// chain: constraints link each block's latent states to those of the next one; cyclic_chain: the last to the first.
enum class LatentStructure { none, independent_blocks, chain, cyclic_chain };

/// A set of records that shares one vector of latent states (possibly of length 0), and one covariance shape.
struct BlockLayout {
    std::string label;       ///< "cycle 3", "run1, segment 0": names the block in messages and reports
    std::vector<int> group;  ///< group of each record, index into the groups
    /// Sigma_b, shape (records, records), symmetric positive definite: V_b = D Sigma_b D, D = diag(s_group(record)).
    /// Empty = identity (and never formed: blocks of 1e5 records are usual).
    Eigen::MatrixXd shape;
    Eigen::VectorXd deviation;  ///< known sd of each record, > 0, times its group's scale; empty = 1. Not with a shape
    Eigen::VectorXd observed;   ///< y of each record, for errors that depend on the size of the prediction y - e
    Eigen::Index latents = 0;
    /// Equality constraints c(theta, z, z_next) = 0 of this block (continuity): they hold at the estimate.
    Eigen::Index constraints = 0;
    /// Records [linked_from, group.size()) depend on z_next as well; -1: none does. A group has either only linked or
    /// only other records. Not with a shape.
    std::ptrdiff_t linked_from = -1;
    std::ptrdiff_t next = -1;  ///< block whose latent states are z_next; -1: everything depends on theta and z alone
    Eigen::VectorXd constraint_size;  ///< a typical size of each component of z_next - z, > 0; empty = 1
    bool active = true;               ///< false: lost, deactivated or rejected; not used, but counted
};

/// The blocks of a residual, read like a std::vector<BlockLayout>. Copies share them until one is changed: each block
/// of a long chain takes some hundred bytes, and several sets with the same blocks are held at once.
class BlockLayouts {
public:
    BlockLayouts() = default;
    // NOLINTNEXTLINE(google-explicit-constructor): a vector is what residuals make and return
    BlockLayouts(std::vector<BlockLayout> blocks)
        : blocks_(std::make_shared<std::vector<BlockLayout>>(std::move(blocks))) {}
    BlockLayouts(std::initializer_list<BlockLayout> blocks) : BlockLayouts(std::vector<BlockLayout>(blocks)) {}

    [[nodiscard]] const std::vector<BlockLayout>& all() const {
        static const std::vector<BlockLayout> none;
        return blocks_ ? *blocks_ : none;
    }
    // NOLINTNEXTLINE(google-explicit-constructor): see above
    operator const std::vector<BlockLayout>&() const { return all(); }
    /// For changes. What other copies share is copied first; references from before do not see the change.
    [[nodiscard]] std::vector<BlockLayout>& edit() {
        if (!blocks_ || blocks_.use_count() > 1) blocks_ = std::make_shared<std::vector<BlockLayout>>(all());
        return *blocks_;
    }

    [[nodiscard]] std::size_t size() const { return all().size(); }
    [[nodiscard]] bool empty() const { return all().empty(); }
    [[nodiscard]] const BlockLayout& operator[](std::size_t b) const { return all()[b]; }
    [[nodiscard]] const BlockLayout& front() const { return all().front(); }
    [[nodiscard]] const BlockLayout& back() const { return all().back(); }
    [[nodiscard]] auto begin() const { return all().begin(); }
    [[nodiscard]] auto end() const { return all().end(); }

private:
    std::shared_ptr<std::vector<BlockLayout>> blocks_;  ///< null: none
};

enum class BlockStatus { ok, failed };

/// e = y - yhat(theta, z) of one block in the unit of each record, with derivatives.
struct BlockValue {
    BlockStatus status = BlockStatus::ok;
    Eigen::VectorXd e;
    Eigen::MatrixXd e_theta;  ///< shape (records, parameters); empty when derivatives were not requested
    Eigen::MatrixXd e_z;      ///< shape (records, latents)
    /// Records that also depend on the latent states of the next block (continuity with an error of its own): shape
    /// (records, latents of the next block); empty when none does. Chains only.
    Eigen::MatrixXd e_next;
    Eigen::VectorXd c;        ///< constraints, shape (constraints)
    Eigen::MatrixXd c_theta;  ///< shape (constraints, parameters)
    Eigen::MatrixXd c_z;      ///< shape (constraints, latents)
    Eigen::MatrixXd c_next;   ///< shape (constraints, latents of the next block)
};

/// What may change of a residual between two minimisations, as a value: the estimator keeps one for each residual, and
/// a run that continues stores it.
struct ActiveSet {
    std::vector<Group> groups;  ///< Residual::groups() with the present values of fixed scales
    BlockLayouts layout;        ///< Residual::layout() with the present blocks
    /// One vector per block, of length layout[b].latents: where a block starts that is new or comes back.
    std::vector<Eigen::VectorXd> latents;
    /// This is an intermediate stage (with a continuity sd that update_active_set() will lower). It is minimised only
    /// roughly, and error scales stay at the values of `groups`, read anew for each such stage. update_active_set() is
    /// called again until this is false.
    bool is_intermediate_stage = false;
    std::vector<Eigen::VectorXd> memory;  ///< for the residual alone: weights, last solutions
};

/// What update_active_set() did to the set of blocks between two minimisations.
struct RefreshReport {
    bool changed = false;  ///< another minimisation is needed
    int lost = 0;          ///< blocks that can no longer be evaluated
    int rejected = 0;      ///< gross errors
    int added = 0;
};

/// A source of residuals. It knows models and data; the estimator knows neither. It never changes: what an estimate
/// changes is its ActiveSet. All functions are thread-safe.
class Residual {
public:
    virtual ~Residual() = default;

    [[nodiscard]] virtual std::string_view type() const = 0;  ///< "cycles", "series"
    /// Groups and blocks at the start.
    [[nodiscard]] virtual const std::vector<Group>& groups() const = 0;
    [[nodiscard]] virtual const std::vector<BlockLayout>& layout() const = 0;
    [[nodiscard]] virtual LatentStructure structure() const = 0;
    /// Responses with a full covariance; default: none, groups are independent of each other.
    [[nodiscard]] virtual std::vector<JointCovariance> covariances() const { return {}; }
    /// One vector per block, of length layout()[b].latents.
    [[nodiscard]] virtual std::vector<Eigen::VectorXd> initial_latents() const = 0;
    /// The set with which an estimate begins. Default: groups, blocks and latent states as above.
    [[nodiscard]] virtual ActiveSet initial_set() const { return {groups(), layout(), initial_latents(), false, {}}; }
    /// Values of all ACTIVE blocks (others are left empty), theta in natural units, in the order of the estimate's
    /// parameters. A block that cannot be evaluated has status failed; it does not throw.
    [[nodiscard]] virtual std::vector<BlockValue> evaluate(const ActiveSet& active, const Eigen::VectorXd& theta,
                                                           const std::vector<Eigen::VectorXd>& latents,
                                                           bool derivatives) const = 0;
    /// Called between two minimisations: gating, new starting solutions, continuity. scales = current s_g of the
    /// groups. Of groups it may change the values of fixed scales, nothing else. The estimator itself takes blocks out
    /// that stopped too many steps. Default: nothing changes.
    virtual RefreshReport update_active_set(ActiveSet& /*active*/, const Eigen::VectorXd& /*theta*/,
                                            const std::vector<Eigen::VectorXd>& /*latents*/,
                                            const Eigen::VectorXd& /*scales*/) const {
        return {};
    }

protected:
    Residual() = default;
    Residual(const Residual&) = default;
    Residual& operator=(const Residual&) = default;
};

}  // namespace orbid::estimator

#pragma GCC visibility pop

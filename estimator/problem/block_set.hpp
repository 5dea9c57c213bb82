#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/algebra/spread.hpp"
#include "estimator/errors/noise_model.hpp"
#include "estimator/interface/residual.hpp"

namespace orbid::estimator {

/// Latent states: per residual, per block (including inactive ones).
using Latents = std::vector<std::vector<Eigen::VectorXd>>;

/// One group of one residual: records with a common error scale s_g.
struct Channel {
    std::size_t residual = 0;
    int group = 0;
};

/// The records of one law within a block; several responses: one response after the other.
struct LawPart {
    std::size_t law = 0;
    std::vector<Eigen::Index> records;
    Eigen::VectorXd observed;  ///< y of the records; empty unless the law needs it
};

/// How the records of a block are sorted. Most blocks of a residual are alike and share one of these.
struct BlockRecords {
    std::vector<int> channel;           ///< of each record, index into the channels of the estimate; -1: not used
    std::vector<LawPart> parts;         ///< the records by law; empty with a covariance shape
    std::vector<LawPart> linked_parts;  ///< those that depend on the latent states of `next` as well
};

/// One active block of a minimisation.
struct ActiveBlock {
    std::size_t residual = 0;
    std::size_t block = 0;
    std::shared_ptr<const BlockRecords> records;  ///< never null in a BlockSet
    Eigen::Index latents = 0;
    Eigen::MatrixXd cholesky;   ///< lower L, Sigma_b = L L^T; empty = identity
    Eigen::VectorXd deviation;  ///< known sd of each record; empty = 1
    Eigen::Index constraints = 0;
    std::ptrdiff_t next = -1;         ///< index into BlockSet::blocks
    Eigen::VectorXd constraint_size;  ///< shape (constraints)

    [[nodiscard]] const std::vector<int>& channel() const { return records->channel; }
    [[nodiscard]] const std::vector<LawPart>& parts() const { return records->parts; }
    [[nodiscard]] const std::vector<LawPart>& linked_parts() const { return records->linked_parts; }
};

/// The set of blocks of one minimisation; it does not change while the objective is minimised (M11).
struct BlockSet {
    std::vector<ActiveSet> active;  ///< of each residual, from which the rest is made
    std::vector<ActiveBlock> blocks;
    Eigen::VectorXd count;       ///< records of each channel
    double ln_det_shapes = 0.0;  ///< sum over blocks of ln|Sigma_b|, known sds included
    Eigen::Index records = 0;
    Eigen::Index latents = 0;
    Eigen::Index constraints = 0;
    bool linked = false;       ///< some records depend on the states of the next block
    bool provisional = false;  ///< see ActiveSet::is_intermediate_stage
    std::size_t all_blocks = 0;
    /// Over ranks, all numbers above are those of all ranks, and the functions below that take a set are operations of
    /// all ranks together.
    Spread spread;
};

/// All groups of all residuals, in order.
[[nodiscard]] std::vector<Channel> channels_of(const std::vector<const Residual*>& residuals);

/// The sets with which an estimate begins. @throws std::invalid_argument naming a residual that is null.
[[nodiscard]] std::vector<ActiveSet> initial_sets(const std::vector<const Residual*>& residuals);

/// The active blocks of these sets. Constraints and linked records whose next block is inactive are left
/// out.
///
/// @throws std::invalid_argument naming the block. Shapes: of the wrong size or not positive definite; with errors that
///         are not normal. Data: known sds or observed values missing or out of range; a record of a group that does
///         not exist. Structure: latent states or constraints in a block without structure. Linked records: outside
///         chains, without a next block, with a shape, or of a group (or of responses with one full covariance) that
///         has other records as well.
[[nodiscard]] BlockSet freeze(const std::vector<const Residual*>& residuals, std::vector<ActiveSet> active,
                              const std::vector<Channel>& channels, const std::vector<NoiseModel>& laws);

/// The label of a block of the set.
[[nodiscard]] const std::string& label_of(const BlockSet& set, const ActiveBlock& block);

/// Whether these blocks, indices into set.blocks, are half of some residual's or more.
[[nodiscard]] bool half_of_a_residual(const BlockSet& set, const std::vector<std::size_t>& blocks);

/// Values of the active blocks, in their order.
struct Evaluation {
    std::vector<BlockValue> values;
    std::vector<std::size_t> failed;  ///< indices into BlockSet::blocks; a value that is not finite counts as failed
    bool any_failed = false;          ///< here or on another rank
};

/// Errors and constraints of the active blocks one after the other: what is kept of values without their derivatives.
class BlockErrors {
public:
    BlockErrors() = default;
    explicit BlockErrors(const std::vector<BlockValue>& values);

    [[nodiscard]] Eigen::Map<const Eigen::VectorXd> e(std::size_t b) const { return part(2 * b); }
    [[nodiscard]] Eigen::Map<const Eigen::VectorXd> c(std::size_t b) const { return part(2 * b + 1); }

private:
    [[nodiscard]] Eigen::Map<const Eigen::VectorXd> part(std::size_t i) const {
        return {values_.data() + begin_[i], static_cast<Eigen::Index>(begin_[i + 1] - begin_[i])};
    }

    std::vector<double> values_;
    std::vector<std::size_t> begin_;  ///< of e and c of each block, and the end
};

/// Evaluates every residual once. @throws std::invalid_argument naming the block when a result has the wrong shape.
[[nodiscard]] Evaluation evaluate(const std::vector<const Residual*>& residuals, const BlockSet& set,
                                  const std::vector<NoiseModel>& laws, const Eigen::VectorXd& theta,
                                  const Latents& latents, bool derivatives);

/// The same at the end of a step that may be given up: all blocks count as failed where models::Stopped is thrown.
[[nodiscard]] Evaluation evaluate_trial(const std::vector<const Residual*>& residuals, const BlockSet& set,
                                        const std::vector<NoiseModel>& laws, const Eigen::VectorXd& theta,
                                        const Latents& latents, bool derivatives);

/// The errors of one law's records in the unit of the law: e, e divided by known sds, or ln y - ln yhat for log-normal
/// errors.
[[nodiscard]] Eigen::VectorXd law_errors(const ActiveBlock& block, const LawPart& part, const NoiseModel& law,
                                         const Eigen::Ref<const Eigen::VectorXd>& e);

/// Change of -ln p of all blocks between two evaluations, without the cancellation of two sums.
[[nodiscard]] double value_change(const BlockSet& set, const std::vector<NoiseModel>& laws, const Eigen::VectorXd& psi,
                                  const BlockErrors& from, const BlockErrors& to);

/// The same of each block.
[[nodiscard]] std::vector<double> value_changes(const BlockSet& set, const std::vector<NoiseModel>& laws,
                                                const Eigen::VectorXd& psi, const BlockErrors& from,
                                                const BlockErrors& to);

/// Constraints divided by their sizes: 1/2 sum (c / size)^2 at `to` minus the same at `from`.
[[nodiscard]] double violation_change(const BlockSet& set, const BlockErrors& from, const BlockErrors& to);
/// Root mean square of c / size; 0 without constraints.
[[nodiscard]] double violation(const BlockSet& set, const BlockErrors& errors);

/// Scale s of each channel.
[[nodiscard]] Eigen::VectorXd scales_of(const std::vector<NoiseModel>& laws, const Eigen::VectorXd& psi);

/// w = L^-1 D^-1 a: rows divided by their error, in place. `channel` of each row, `scale` of each channel.
void whiten(const std::vector<int>& channel, const Eigen::MatrixXd& cholesky, const Eigen::VectorXd& scale,
            Eigen::MatrixXd& rows);

}  // namespace orbid::estimator

#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/eigen_layout.hpp"
#include "estimator/interface/estimate_result.hpp"
#include "estimator/interface/random_stream.hpp"
#include "estimator/interface/residual.hpp"

namespace orbid::estimator {

/// Where the errors of new records come from.
enum class ErrorDraw {
    automatic,   ///< `blocks` where residuals are correlated beyond what their error law says, else `parametric`
    parametric,  ///< from the estimated error laws
    blocks       ///< from the residuals, in blocks of consecutive ones: what the model misses stays in
};
/// "auto", "parametric", "blocks".
[[nodiscard]] const char* name(ErrorDraw draw);

/// Whether errors have their own sign, or the opposite one. What is linear in errors cancels in the mean of the two.
enum class Mirror { none, opposite };

struct RecordDrawOptions {
    ErrorDraw kind = ErrorDraw::automatic;
    std::uint64_t seed = 1;
    /// A fixed sd of linked records (continuity of nodes) is that of real errors, not a slack that the computation
    /// needs.
    bool fixed_links_err = false;
    /// > 0: errors are added to the record as it was read, of this share of their variance. 0: they replace its own.
    double added = 0.0;
};

/// New records of the experiment that an estimate describes: what it predicts, with other errors.
///
///     y* = yhat + e*   at every record, so that   e*(theta, z) = e(theta, z) + shift,   shift = e* - e(estimate)
///
/// The course that the estimate found is the true one: its nodes, initial states and orbits. A chaotic record is not
/// simulated over its whole length, where arithmetic alone would lead it elsewhere. Linked records (continuity) whose
/// sd is a slack of the computation (fixed, or estimated and at its floor) have no errors: the found course then is an
/// exact one. Those with an estimated sd have errors of that sd: process noise.
///
/// Added errors leave the record what it is, with the course that made it: y* = y + sqrt(added) e*, shift the same.
///
/// Blocks: errors in units of their own sd, mean taken off, scaled to a mean square of 1 (heavy-tailed laws keep
/// theirs). Groups of ordered records are drawn in blocks of the longest block_length() of their residual, at the same
/// places in groups of equal length; others one by one.
class RecordDraws {
public:
    /// @param estimate  of these residuals, not failed. They are not owned.
    /// @throws models::DataError when blocks are asked for, but links have errors that nodes have taken up: these
    ///         residuals do not show the errors of the record.
    /// @throws std::invalid_argument when the estimate has other residuals.
    RecordDraws(const std::vector<const Residual*>& residuals, const Estimate& estimate,
                const RecordDrawOptions& options);

    /// Never automatic.
    [[nodiscard]] ErrorDraw kind() const { return kind_; }
    /// Whether errors are added to the record as it was read.
    [[nodiscard]] bool added() const { return added_ > 0.0; }
    /// Longest blocks of any group; 1: errors are drawn one by one.
    [[nodiscard]] std::size_t longest_block() const;

    /// What is to be added to the errors of every active block: per residual, per block (empty: not active).
    [[nodiscard]] std::vector<std::vector<Eigen::VectorXd>> shifts(std::size_t replicate,
                                                                   Mirror mirror = Mirror::none) const;

private:
    struct Place {
        std::size_t block;
        Eigen::Index record;
    };
    /// The errors of one group.
    struct Channel {
        ErrorDistribution distribution;
        double scale = 1.0;
        double shape = 0.0;    ///< dof, relative or correlation
        bool linked = false;   ///< to the next block
        bool exact = false;    ///< without errors
        bool ordered = false;  ///< in time
        std::vector<std::vector<Place>> sequences;
        std::vector<double> pool;  ///< units of all sequences, standardised
    };
    struct Source {
        const ActiveSet* active = nullptr;
        std::vector<Eigen::VectorXd> fitted;       ///< e at the estimate, per block
        std::vector<Eigen::MatrixXd> shape_roots;  ///< of BlockLayout::shape, per block; empty: none
        std::vector<Channel> channels;
        std::size_t length = 1;  ///< of blocks of ordered groups
        /// Groups of full covariances, each with L over its groups' scales.
        std::vector<std::pair<std::vector<int>, Eigen::MatrixXd>> joint;
    };

    [[nodiscard]] Source source_of(const Residual& residual, const Estimate& estimate, std::size_t index,
                                   std::size_t first_channel, bool fixed_links_err) const;
    static void gather(Source& source);
    [[nodiscard]] static double local_sd(const Source& source, const Channel& channel, std::size_t block,
                                         Eigen::Index record);
    [[nodiscard]] static Eigen::VectorXd units(const Source& source, std::size_t block);
    [[nodiscard]] static std::vector<std::vector<double>> sequences(const Source& source, const Channel& channel);
    [[nodiscard]] static bool is_correlated(const Source& source);
    static void couple(const Source& source, std::size_t block, Eigen::VectorXd& unit);
    [[nodiscard]] Eigen::VectorXd shift_of(const Source& source, std::size_t block, const Eigen::VectorXd& unit) const;
    void draw(const Channel& channel, std::size_t length, RandomStream random,
              std::vector<Eigen::VectorXd>& unit) const;

    std::uint64_t seed_;
    ErrorDraw kind_;
    double added_;
    std::vector<Source> sources_;
};

}  // namespace orbid::estimator

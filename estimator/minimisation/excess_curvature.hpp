#pragma once

#include <cstddef>
#include <map>
#include <vector>

#include "estimator/minimisation/trust_region.hpp"
#include "estimator/problem/problem.hpp"

namespace orbid::estimator {

/// Curvature of the objective beyond Gauss-Newton's, in the latent states of single blocks, by secants.
///
/// Where a course hardly passes an unstable equilibrium, residuals times second derivatives may outweigh what
/// Gauss-Newton sees. Its steps overshoot in these few blocks of a long chain and converge slowly there, and all
/// blocks share their trust region. What the objective of a block did beyond what its model had told, over half the
/// square of its step, is the curvature that is added to its states from then on (secant method; compare the
/// structured secant updates of Dennis, Gay and Welsch, ACM Trans. Math. Softw. 7, 1981). The minimum stays where it
/// is.
class ExcessCurvature {
public:
    ExcessCurvature(const Problem& problem, const BlockSet& set) : problem_(problem), set_(set) {}

    /// By blocks of the set, see BlockRows::excess.
    [[nodiscard]] const std::map<std::size_t, double>& of_blocks() const { return excess_; }
    /// The latent states of these blocks of chains stay where they are until release(), if then at most so many are
    /// held.
    /// @return whether more are held than before
    bool hold(const std::vector<std::size_t>& blocks, std::size_t most);
    /// They move again. @return how many were held
    std::size_t release();
    /// Keeps what the model tells of each block, if the trial of this step will be compared with it.
    void expect(const BlockArrow& arrow, const TrialStep& step);
    /// Learns from a trial that could be evaluated.
    /// @param gain  actual over predicted decrease of the whole step
    void compare(const Eigen::VectorXd& psi, const BlockErrors& from, const std::vector<BlockValue>& to, double gain);

private:
    [[nodiscard]] bool possible() const;

    const Problem& problem_;
    const BlockSet& set_;
    std::map<std::size_t, double> excess_;
    int watched_ = 0;  ///< trials that are still compared since one went otherwise than told
    /// Change of each block by the Gauss-Newton model, and the square of its step in lengths of its own columns.
    std::vector<double> told_;
    std::vector<double> square_;
};

}  // namespace orbid::estimator

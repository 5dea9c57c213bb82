#pragma once

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "estimator/interface/not_finite.hpp"
#include "estimator/minimisation/minimum.hpp"
#include "estimator/minimisation/step_rules.hpp"

namespace orbid::estimator {

/// Where a minimisation stands before a step.
struct Standing {
    double remaining = 0.0;        ///< length of the full step, in posterior sds
    double rounding = 0.0;         ///< see ErrorLimits
    bool at_floor = false;         ///< every error scale is held at its lower limit
    bool radius_vanished = false;  ///< the trust region is below the rounding of parameters
    bool stages_left = false;      ///< constraints can still tighten
};

/// What comes next: a step, the next stage of the constraints, or the end with its outcome.
struct Decision {
    enum class Next { step, stage, end };
    Next next = Next::step;
    Outcome outcome = Outcome::converged;
    std::string message;
};

/// When a minimisation ends: how its steps go, and which blocks they fail at.
class Stopping {
public:
    Stopping(const Problem& problem, const BlockSet& set, const SolverStatistics& ledger)
        : problem_(problem), set_(set), ledger_(ledger), failures_(set.blocks.size(), 0), cut_(set.blocks.size()) {}

    [[nodiscard]] Decision decide(const Standing& standing);
    /// Whether latent states may hold up all others: steps do not shorten what is left. After decide().
    [[nodiscard]] bool held_up(const Standing& standing) const;

    /// This block failed at a trial of the present step.
    void note_failure(std::size_t block) { cut_[block] = true; }
    /// Counts a trial. @return blocks that stopped too many steps; the minimisation then ends
    [[nodiscard]] std::vector<std::size_t> rejected();
    [[nodiscard]] std::vector<std::size_t> accepted();
    /// What has been tried does not count any more: the minimum has become another one.
    void begin_again();
    /// Once the convergence test is met, further steps gain nothing.
    void expect_no_digits() { polishing_ = polishing_steps; }
    /// Where a minimisation goes along kinks, fewer rejections show the next one. @return whether that changed
    bool expect_kinks(bool expected) {
        const int before = std::exchange(enough_rejections_, expected ? few_rejections : many_rejections);
        return before != enough_rejections_;
    }
    [[nodiscard]] bool after_rejection() const { return rejected_ > 0; }
    [[nodiscard]] bool at_start() const { return accepted_ == 0; }  ///< before the first accepted step
    /// Whether an intermediate stage (see Residual::is_intermediate_stage()) ends with this step.
    [[nodiscard]] bool ends_intermediate_stage(const StepTaken& step) const;

private:
    /// Trials in a row that fail before a step is given up.
    static constexpr int many_rejections = 30, few_rejections = 10;
    /// After the convergence test is met, steps go on while they gain digits, at most this many.
    static constexpr int polishing_steps = 12;

    void note_remaining(double remaining);
    [[nodiscard]] bool gains_no_digits(double remaining) const;
    [[nodiscard]] static bool within_rounding(const Standing& standing);
    [[nodiscard]] bool exhausted(const Standing& standing) const;
    [[nodiscard]] std::vector<std::size_t> standing_out(std::vector<std::size_t> blocks) const;

    const Problem& problem_;
    const BlockSet& set_;
    const SolverStatistics& ledger_;
    int accepted_ = 0;
    int rejected_ = 0;  ///< trials in a row
    int enough_rejections_ = many_rejections;
    int polishing_ = 0;          ///< steps since the convergence test is met
    int stagnant_ = 0;           ///< steps without halving what is left
    double last_ = infinity;     ///< what was left before the last step
    double least_ = infinity;    ///< the least that was left when it was last halved
    std::vector<int> failures_;  ///< steps in a row that had to be shortened because of each block
    std::vector<bool> cut_;      ///< blocks that failed at a trial of the present step
};

}  // namespace orbid::estimator

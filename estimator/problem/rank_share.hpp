#pragma once

#include <string>

#include "estimator/problem/block_set.hpp"
#include "estimator/problem/problem.hpp"

/// What ranks tell each other of an estimate besides sums. All are operations of all ranks together.
namespace orbid::estimator {

/// @throws std::invalid_argument on every rank when one was given other parameters, groups or options than rank 0.
void check_alike(const Problem& problem, const State& state);

/// Makes the numbers of a set those of all ranks, each shared block counted once.
/// @throws std::invalid_argument when a shared block does not fit ChainShare, or blocks are not active.
void share_blocks(const Problem& problem, BlockSet& set);

/// Where two ranks have a block, the first takes its states over from the second.
void share_states(const BlockSet& set, State& state);

/// Takes over from rank 0 what a residual changed in its set: fixed scales, floors, the stage, its memory.
/// @param changed  whether it changed its blocks. @throws std::invalid_argument then, on every rank.
void agree_on_set(Collective& ranks, const std::string& residual, bool changed, ActiveSet& active);

}  // namespace orbid::estimator

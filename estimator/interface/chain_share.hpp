#pragma once

namespace orbid::estimator {

/// How the blocks of a residual on one rank belong to those on its neighbours.
///
/// A chain may go on from one rank to the next. Both then have the block between them. It is the last block on the
/// first rank, with its latent states but without records or constraints of its own: those are on the second rank, on
/// which it is the first block. Links into it are on the first rank.
struct ChainShare {
    bool begins_earlier = false;  ///< the first block is the last one of the previous rank
    bool goes_on = false;         ///< the last block is the first one of the next rank
};

}  // namespace orbid::estimator

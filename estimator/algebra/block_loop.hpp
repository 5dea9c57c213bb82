#pragma once

#include <algorithm>
#include <cstddef>

#include <oneapi/tbb/parallel_for.h>

namespace orbid::estimator {

/// Blocks per piece of a loop: small enough that the hundred of a short record are distributed, large enough that the
/// overhead is negligible. (A block takes one to five microseconds, distributing a piece about one.)
inline constexpr std::size_t blocks_per_piece = 32;

/// Number of pieces of a loop over `count` blocks; it depends on nothing else.
[[nodiscard]] inline std::size_t pieces_of(std::size_t count) {
    return (count + blocks_per_piece - 1) / blocks_per_piece;
}

/// Calls work(begin, end, piece) for all pieces of [0, count), several at a time. Sums kept per piece and added in
/// their order are the same with any number of threads.
template <class Work>
void for_pieces(std::size_t count, const Work& work) {
    const auto run = [&](std::size_t piece) {
        const std::size_t begin = piece * blocks_per_piece;
        work(begin, std::min(begin + blocks_per_piece, count), piece);
    };
    if (count <= blocks_per_piece) {
        if (count > 0) run(0);
        return;
    }
    oneapi::tbb::parallel_for(std::size_t{0}, pieces_of(count), run);
}

/// Calls work(b) for all blocks of [0, count), several at a time.
template <class Work>
void for_blocks(std::size_t count, const Work& work) {
    for_pieces(count, [&](std::size_t begin, std::size_t end, std::size_t) {
        for (std::size_t b = begin; b < end; ++b)
            work(b);
    });
}

}  // namespace orbid::estimator

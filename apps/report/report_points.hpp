#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace orbid::apps {

/// Points of a section made small: blocks that the page decodes one by one (apps/report/script/section_points.js).
struct PointBlocks {
    struct Block {
        std::size_t count;
        std::string base64;
    };
    std::vector<Block> blocks;
    std::size_t given = 0;  ///< points handed over
    std::size_t kept = 0;   ///< points in the blocks
};

/// Points of a section that a page holds; of more every k-th is taken.
inline constexpr std::size_t most_points = std::size_t{1} << 20;

/// Takes pairs of coordinates as shares of their axes, in [0, 1].
///
/// Both become 16 bits, interleaved to one number (Morton order), so that neighbours in a block are neighbours in the
/// plane; the sorted numbers' differences follow each other in groups of seven bits, the eighth says that more come
/// (LEB128). A million points of a chaotic section take some 2 bytes each.
/// @param most  points kept; of more every k-th is taken, in their order.
[[nodiscard]] PointBlocks point_blocks(const std::vector<std::pair<double, double>>& points,
                                       std::size_t most = most_points);

/// The bits of a 16-bit number, one place apart from each other: 0b1011 -> 0b1000101.
[[nodiscard]] std::uint32_t spread_bits(std::uint16_t value);

}  // namespace orbid::apps

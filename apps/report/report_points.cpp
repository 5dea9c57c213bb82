#include "apps/report/report_points.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "apps/report/base64_text.hpp"

namespace orbid::apps {

namespace {

/// Points that the page decodes in one go: a few milliseconds.
constexpr std::size_t block_points = std::size_t{1} << 15;

std::uint16_t steps(double share) {
    return static_cast<std::uint16_t>(std::lround(std::clamp(share, 0.0, 1.0) * 65535.0));
}

void append(std::uint32_t value, std::vector<unsigned char>& bytes) {
    while (value > 127) {
        bytes.push_back(static_cast<unsigned char>(value | 128U));
        value >>= 7U;
    }
    bytes.push_back(static_cast<unsigned char>(value));
}

}  // namespace

std::uint32_t spread_bits(std::uint16_t value) {
    std::uint32_t x = value;
    x = (x | (x << 8U)) & 0x00ff00ffU;
    x = (x | (x << 4U)) & 0x0f0f0f0fU;
    x = (x | (x << 2U)) & 0x33333333U;
    return (x | (x << 1U)) & 0x55555555U;
}

PointBlocks point_blocks(const std::vector<std::pair<double, double>>& points, std::size_t most) {
    if (most == 0) throw std::invalid_argument("point blocks: most is 0, must be > 0");
    const std::size_t every = std::max<std::size_t>(1, (points.size() + most - 1) / most);
    std::vector<std::uint32_t> keys;
    keys.reserve(points.size() / every + 1);
    for (std::size_t i = 0; i < points.size(); i += every)
        keys.push_back(spread_bits(steps(points[i].first)) | (spread_bits(steps(points[i].second)) << 1U));
    std::sort(keys.begin(), keys.end());

    PointBlocks out;
    out.given = points.size();
    out.kept = keys.size();
    std::vector<unsigned char> bytes;
    for (std::size_t begin = 0; begin < keys.size(); begin += block_points) {
        const std::size_t end = std::min(keys.size(), begin + block_points);
        bytes.clear();
        std::uint32_t last = 0;  // every block can be read alone
        for (std::size_t i = begin; i < end; ++i) {
            append(keys[i] - last, bytes);
            last = keys[i];
        }
        out.blocks.push_back({end - begin, base64_text(bytes)});
    }
    return out;
}

}  // namespace orbid::apps

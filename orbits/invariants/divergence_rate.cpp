#include "orbits/invariants/divergence_rate.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <tbb/parallel_for.h>

#include "models/arithmetic/median.hpp"

namespace orbid::orbits {
namespace {

constexpr std::size_t references = 20000;  // points whose neighbours are followed
constexpr std::size_t theiler = 1;         // steps in the series that a neighbour is away at least
constexpr std::size_t block_count = 16;    // of references: their scatter is the sd
constexpr std::size_t partners = 4;        // neighbours per reference: more lie farther away and saturate earlier
constexpr int lags = 48;                   // places at which a pair is looked at
constexpr int slowest = 64;                // steps between them at most

// Distances up to here grow as the linearised map does; curvature bends them by a few per cent.
constexpr double linear_range = 0.1;
// Share of the pairs that may be beyond it at the last step.
constexpr double grown_share = 0.1;
// Share of the way in which distances turn into the unstable direction.
constexpr int alignment = 3;

// Of one reference: ln distance at every lag, one path per pair.
using Paths = std::vector<std::vector<double>>;

double path_distance(const SectionPoints& points, const Neighbour& neighbour, std::size_t i, std::size_t step) {
    double sum = 0.0;
    for (Eigen::Index d = 0; d < points.dimension(); ++d) {
        const double sign = neighbour.mirrored ? points.signs()[d] : 1.0;
        const double r =
            points.difference(sign * points.point(neighbour.index + step)[d], points.point(i + step)[d], d);
        sum += r * r;
    }
    return std::sqrt(sum);
}

// Paths of all references with lags `pace` steps apart.
std::vector<Paths> follow_pairs(const SectionPoints& points, const NeighbourIndex& grid, int pace) {
    // Steps that a point can be followed.
    const int longest = lags * pace;
    std::vector<int> ahead(points.size(), 0);
    std::vector<std::size_t> starts;
    for (std::size_t i = points.size(); i-- > 0;)
        if (points.has_image(i)) ahead[i] = std::min(longest, ahead[i + 1] + 1);
    for (std::size_t i = 0; i < points.size(); ++i)
        if (ahead[i] == longest) starts.push_back(i);
    const std::size_t count = std::min(references, starts.size());
    std::vector<Paths> paths(count);
    tbb::parallel_for(std::size_t{0}, count, [&](std::size_t r) {
        const std::size_t i = starts[r * starts.size() / count];
        const Eigen::VectorXd place = Eigen::Map<const Eigen::VectorXd>(points.point(i), points.dimension());
        for (const Neighbour& neighbour : grid.nearest(place, partners + 1 + 2 * theiler)) {
            const std::size_t apart = neighbour.index > i ? neighbour.index - i : i - neighbour.index;
            if ((apart <= theiler && !neighbour.mirrored) || ahead[neighbour.index] < longest) continue;
            if (paths[r].size() == partners) break;
            if (!(neighbour.distance2 > 0.0)) continue;
            std::vector<double> path;
            for (int lag = 0; lag <= lags; ++lag)
                path.push_back(std::log(path_distance(points, neighbour, i, static_cast<std::size_t>(lag * pace))));
            paths[r].push_back(std::move(path));
        }
    });
    return paths;
}

// ln distance that a share of the pairs exceeds; nan without pairs.
double exceeded_by(const std::vector<Paths>& paths, int lag, double share) {
    std::vector<double> values;
    for (const Paths& reference : paths)
        for (const auto& path : reference)
            values.push_back(path[static_cast<std::size_t>(lag)]);
    if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
    const auto place = static_cast<std::size_t>((1.0 - share) * static_cast<double>(values.size() - 1));
    return models::ranked(std::move(values), place);
}

int last_linear(const std::vector<Paths>& paths) {
    int last = 0;
    while (last < lags && exceeded_by(paths, last + 1, grown_share) < std::log(linear_range))
        ++last;
    return last;
}

}  // namespace

DivergenceRate divergence_rate(const SectionPoints& points, const NeighbourIndex& grid) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    DivergenceRate result{nan, nan};
    int pace = 1;
    std::vector<Paths> paths = follow_pairs(points, grid, pace);
    int last = last_linear(paths);
    while (last == lags && pace < slowest) {
        pace *= 4;
        paths = follow_pairs(points, grid, pace);
        last = last_linear(paths);
    }
    const int first = std::max(1, last / alignment);
    if (last - first < 2 || paths.size() < block_count) return result;

    std::vector<double> block_rate;
    for (std::size_t b = 0; b < block_count; ++b) {
        double sum = 0.0;
        std::size_t pairs = 0;
        for (std::size_t r = b * paths.size() / block_count; r < (b + 1) * paths.size() / block_count; ++r)
            for (const auto& path : paths[r]) {
                const double grown = path[static_cast<std::size_t>(last)] - path[static_cast<std::size_t>(first)];
                if (!std::isfinite(grown)) continue;  // distance 0: quantised readings
                sum += grown;
                ++pairs;
            }
        if (pairs > 0) block_rate.push_back(sum / static_cast<double>(pairs) / ((last - first) * pace));
    }
    if (block_rate.size() < 2) return result;
    double mean = 0.0, square = 0.0;
    for (const double rate : block_rate)
        mean += rate / static_cast<double>(block_rate.size());
    for (const double rate : block_rate)
        square += (rate - mean) * (rate - mean);
    result.rate = mean;
    result.sd = std::sqrt(square / static_cast<double>(block_rate.size() * (block_rate.size() - 1)));
    return result;
}

}  // namespace orbid::orbits

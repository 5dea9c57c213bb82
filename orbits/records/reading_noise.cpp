#include "orbits/records/reading_noise.hpp"

#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "models/arithmetic/median.hpp"
#include "models/definition/parameter.hpp"

namespace orbid::orbits {

double reading_noise(const Eigen::Ref<const Eigen::VectorXd>& values, bool angle) {
    constexpr double normal_median = 1.4826;
    std::vector<double> known, differences;
    for (const double value : values) {
        if (!std::isfinite(value)) continue;
        known.push_back(angle && !known.empty() ? known.back() + models::wrapped(value - known.back()) : value);
    }
    for (std::size_t k = 4; k < known.size(); ++k)
        differences.push_back(
            std::abs(known[k] - 4.0 * known[k - 1] + 6.0 * known[k - 2] - 4.0 * known[k - 3] + known[k - 4]));
    return normal_median * models::upper_median(std::move(differences)) / std::sqrt(70.0);
}

double samples_per_turn(const Eigen::Ref<const Eigen::VectorXd>& values) {
    constexpr double dead_band = 0.25;  // sds
    double sum = 0.0, squares = 0.0, count = 0.0;
    for (const double value : values) {
        if (!std::isfinite(value)) continue;
        sum += value;
        squares += value * value;
        count += 1.0;
    }
    const double mean = sum / count;
    const double sd = std::sqrt(std::max(squares / count - mean * mean, 0.0));
    bool below = false;
    Eigen::Index first = -1, last = -1, turns = 0;
    for (Eigen::Index k = 0; k < values.size(); ++k) {
        if (values[k] < mean - dead_band * sd) below = true;
        if (!below || !(values[k] > mean)) continue;
        below = false;
        if (first < 0)
            first = k;
        else
            ++turns;
        last = k;
    }
    return turns > 0 ? static_cast<double>(last - first) / static_cast<double>(turns)
                     : static_cast<double>(values.size());
}

}  // namespace orbid::orbits

#include "estimator/exploration/block_resampling.hpp"

#include <algorithm>
#include <cmath>

namespace orbid::estimator {

namespace {

/// Autocovariances about the mean of all, R(0) ... R(lags); the divisor is the number of all records.
std::vector<double> autocovariances(const std::vector<std::vector<double>>& sequences, double count, std::size_t lags) {
    double mean = 0.0;
    for (const auto& sequence : sequences)
        for (const double error : sequence)
            mean += error / count;
    std::vector<double> covariances(lags + 1, 0.0);
    for (const auto& sequence : sequences)
        for (std::size_t lag = 0; lag <= lags && lag < sequence.size(); ++lag)
            for (std::size_t i = lag; i < sequence.size(); ++i)
                covariances[lag] += (sequence[i] - mean) * (sequence[i - lag] - mean) / count;
    return covariances;
}

/// The last lag with a correlation beyond chance; 0: none.
std::size_t last_correlated_lag(const std::vector<double>& covariances, double bound, std::size_t quiet,
                                std::size_t most) {
    std::size_t in_a_row = 0;
    for (std::size_t lag = 1; lag < covariances.size(); ++lag) {
        in_a_row = std::abs(covariances[lag]) < bound * covariances[0] ? in_a_row + 1 : 0;
        if (in_a_row == quiet) return lag - quiet;
    }
    return most;
}

}  // namespace

std::size_t block_length(const std::vector<std::vector<double>>& sequences) {
    double count = 0.0;
    for (const auto& sequence : sequences)
        count += static_cast<double>(sequence.size());
    constexpr double least_count = 10.0;
    if (count < least_count) return 1;
    const double digits = std::log10(count);
    const double root = std::sqrt(count);
    const double bound = std::max(2.0 * std::sqrt(digits), 3.0) / root;
    const auto quiet = static_cast<std::size_t>(std::max(5.0, std::ceil(std::sqrt(digits))));
    const auto most = static_cast<std::size_t>(std::ceil(root));
    const std::vector<double> covariances = autocovariances(sequences, count, 2 * (most + quiet));
    if (!(covariances[0] > 0.0)) return 1;
    const std::size_t window = 2 * std::min(last_correlated_lag(covariances, bound, quiet, most), most);
    if (window == 0) return 1;
    double sum = covariances[0];
    double moment = 0.0;
    for (std::size_t lag = 1; lag <= window; ++lag) {
        const double weight = std::min(1.0, 2.0 * (1.0 - static_cast<double>(lag) / static_cast<double>(window)));
        sum += 2.0 * weight * covariances[lag];
        moment += 2.0 * weight * static_cast<double>(lag) * covariances[lag];
    }
    const double longest = std::floor(std::min(3.0 * root, count / 3.0));
    // Correlations that cancel in the sum ask for the longest blocks.
    const double length = std::cbrt(1.5 * moment * moment / (sum * sum) * count);
    return static_cast<std::size_t>(std::isfinite(length) ? std::clamp(std::ceil(length), 1.0, longest) : longest);
}

std::vector<std::size_t> drawn_blocks(std::size_t count, std::size_t pool, std::size_t length, RandomStream random) {
    std::vector<std::size_t> drawn;
    drawn.reserve(count);
    while (drawn.size() < count) {
        const auto begin = static_cast<std::size_t>(random.uniform() * static_cast<double>(pool));
        for (std::size_t i = 0; i < length && drawn.size() < count; ++i)
            drawn.push_back((begin + i) % pool);
    }
    return drawn;
}

bool standardise(std::vector<double>& errors) {
    const auto count = static_cast<double>(errors.size());
    double mean = 0.0;
    for (const double error : errors)
        mean += error / count;
    double squares = 0.0;
    for (const double error : errors)
        squares += (error - mean) * (error - mean) / count;
    const double rms = std::sqrt(squares);
    if (!(rms > 0.0) || !std::isfinite(rms)) return false;
    for (double& error : errors)
        error = (error - mean) / rms;
    return true;
}

}  // namespace orbid::estimator

#pragma once

#include <cstdint>

namespace orbid::apps {

/// Share of the intervals of a result that should contain the truth: `interval95`.
inline constexpr double interval_level = 0.95;

struct BinomialInterval {
    double lower = 0;
    double upper = 1;
};

/// Interval of Clopper and Pearson for the probability of an event that was seen `count` times of `trials`: it holds
/// the probability at least as often as `level` says. [0, 1] without trials.
/// Source: C. J. Clopper, E. S. Pearson, Biometrika 26 (1934) 404, by quantiles of the beta distribution.
/// @throws std::invalid_argument unless 0 <= count <= trials and 0 < level < 1.
[[nodiscard]] BinomialInterval binomial_interval(std::int64_t count, std::int64_t trials, double level = 0.95);

}  // namespace orbid::apps

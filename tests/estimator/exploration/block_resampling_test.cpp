#include "estimator/exploration/block_resampling.hpp"

#include <cmath>
#include <vector>

#include "tests/catch.hpp"

namespace orbid::tests::block_resampling_test {

using estimator::block_length;
using estimator::RandomPurpose;
using estimator::RandomStream;

namespace {

/// Stationary first-order autoregression of sd 1.
std::vector<double> autoregression(std::size_t count, double correlation, std::uint64_t index) {
    RandomStream random(3, RandomPurpose::reading_noise, index);
    std::vector<double> errors{random.normal()};
    while (errors.size() < count)
        errors.push_back(correlation * errors.back() + std::sqrt(1.0 - correlation * correlation) * random.normal());
    return errors;
}

/// The length that Politis and White's formula has for an autoregression: G / g(0) = 2 rho / (1 - rho^2) for
/// R(k) = rho^k, so that b = (1.5 (2 rho / (1 - rho^2))^2 n)^(1/3).
double known_length(double rho, double count) {
    const double ratio = 2.0 * rho / (1.0 - rho * rho);
    return std::cbrt(1.5 * ratio * ratio * count);
}

}  // namespace

TEST_CASE("blocks are as long as the correlation asks for", "[estimator][bootstrap]") {
    CHECK(known_length(0.6, 4000) > 20.0);
    for (const double rho : {0.3, 0.6, 0.8}) {
        CAPTURE(rho);
        // The estimated ratio scatters; over these 20 records by a sixth at most, measured, so that half is far off.
        double mean = 0.0;
        for (std::uint64_t i = 0; i < 20; ++i)
            mean += static_cast<double>(block_length({autoregression(4000, rho, i)})) / 20.0;
        CHECK_THAT(mean, WithinRel(known_length(rho, 4000), 0.25));
    }
    int uncorrelated = 0;
    for (std::uint64_t i = 0; i < 40; ++i)
        uncorrelated += block_length({autoregression(400, 0.0, 100 + i)}) == 1 ? 1 : 0;
    // Five correlations beyond three sds by chance: 1.4 %.
    CHECK(uncorrelated >= 37);
}

TEST_CASE("short, constant and ringing errors have a block length", "[estimator][bootstrap]") {
    CHECK(block_length({}) == 1);
    CHECK(block_length({{1.0, 2.0, 3.0}}) == 1);
    CHECK(block_length({std::vector<double>(50, 0.0)}) == 1);
    std::vector<double> ringing;
    for (int i = 0; i < 900; ++i)
        ringing.push_back(std::sin(0.7 * i));
    // Correlations that never end: as long as they may be, 3 sqrt(n).
    CHECK(block_length({ringing}) > 20);
    CHECK(block_length({ringing}) <= 90);
}

TEST_CASE("drawn blocks are consecutive, circular, and take every error equally often", "[estimator][bootstrap]") {
    const auto drawn = estimator::drawn_blocks(1000, 10, 4, {1, RandomPurpose::bootstrap, 5});
    REQUIRE(drawn.size() == 1000);
    std::vector<int> counts(10, 0);
    for (std::size_t i = 0; i < drawn.size(); ++i) {
        REQUIRE(drawn[i] < 10);
        ++counts[drawn[i]];
        if (i % 4 != 0) CHECK(drawn[i] == (drawn[i - 1] + 1) % 10);
    }
    // 250 starts: each index is in 100 +- 4 sqrt(250 0.1 0.9 ...) of the draws; 5 sds are 60.
    for (const int count : counts)
        CHECK(std::abs(count - 100) < 60);
}

TEST_CASE("standardised errors have mean 0 and sd 1", "[estimator][bootstrap]") {
    std::vector<double> errors{1.0, 2.0, 6.0};
    REQUIRE(estimator::standardise(errors));
    CHECK_THAT(errors[0] + errors[1] + errors[2], WithinAbs(0.0, 1e-14));
    CHECK_THAT(errors[0] * errors[0] + errors[1] * errors[1] + errors[2] * errors[2], WithinRel(3.0, 1e-14));
    std::vector<double> constant{2.0, 2.0};
    CHECK_FALSE(estimator::standardise(constant));
    CHECK(constant == std::vector<double>{2.0, 2.0});
    std::vector<double> broken{1.0, std::nan("")};
    CHECK_FALSE(estimator::standardise(broken));
}

}  // namespace orbid::tests::block_resampling_test

#include "estimator/interface/random_stream.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/catch.hpp"

namespace random_stream_test {

using namespace orbid;
using estimator::RandomPurpose;
using estimator::RandomStream;

// Known-answer vectors of Philox-4x64-10 as published with the generator (Random123, kat_vectors): counter, key,
// result.
TEST_CASE("the generator gives the published vectors", "[estimator][reference]") {
    const r123::Philox4x64 philox;
    const auto answer = [&](std::array<std::uint64_t, 4> c, std::array<std::uint64_t, 2> k) {
        const auto r =
            philox(r123::Philox4x64::ctr_type{{c[0], c[1], c[2], c[3]}}, r123::Philox4x64::key_type{{k[0], k[1]}});
        return std::array<std::uint64_t, 4>{r[0], r[1], r[2], r[3]};
    };
    constexpr std::uint64_t ones = ~std::uint64_t{0};
    CHECK(answer({0, 0, 0, 0}, {0, 0}) ==
          std::array<std::uint64_t, 4>{0x16554d9eca36314c, 0xdb20fe9d672d0fdc, 0xd7e772cee186176b, 0x7e68b68aec7ba23b});
    CHECK(answer({ones, ones, ones, ones}, {ones, ones}) ==
          std::array<std::uint64_t, 4>{0x87b092c3013fe90b, 0x438c3c67be8d0224, 0x9cc7d7c69cd777b6, 0xa09caebf594f0ba0});
    CHECK(answer({0x243f6a8885a308d3, 0x13198a2e03707344, 0xa4093822299f31d0, 0x082efa98ec4e6c89},
                 {0x452821e638d01377, 0xbe5466cf34e90c6c}) ==
          std::array<std::uint64_t, 4>{0xa528f45403e61d95, 0x38c72dbd566e9788, 0xa5a1610e72fd18b5, 0x57bd43b5e52b7fe6});
}

TEST_CASE("a stream is the generator at key (seed, purpose) and counter (block, index)", "[estimator]") {
    RandomStream stream(42, RandomPurpose::reading_noise, 7);
    for (std::uint64_t block = 0; block < 3; ++block) {
        const auto expected =
            r123::Philox4x64()(r123::Philox4x64::ctr_type{{block, 7, 0, 0}}, r123::Philox4x64::key_type{{42, 2}});
        for (std::size_t i = 0; i < 4; ++i)
            CHECK(stream.bits() == expected[i]);
    }
}

TEST_CASE("streams depend on seed, purpose and index, and on nothing else", "[estimator]") {
    const auto first = [](std::uint64_t seed, RandomPurpose purpose, std::uint64_t index) {
        return RandomStream(seed, purpose, index).bits();
    };
    const auto reference = first(1, RandomPurpose::initial_state, 0);
    CHECK(first(1, RandomPurpose::initial_state, 0) == reference);
    CHECK(first(2, RandomPurpose::initial_state, 0) != reference);
    CHECK(first(1, RandomPurpose::reading_noise, 0) != reference);
    CHECK(first(1, RandomPurpose::initial_state, 1) != reference);
}

// Moments of 10 x 2e5 numbers against their known values; every deviation is judged in Monte-Carlo standard errors.
// With 10 seeds x 4 moments a sound generator exceeds 5 standard errors once in 4e4 such tests.
TEST_CASE("uniform and normal numbers have their moments", "[estimator]") {
    constexpr int count = 200000;
    const double root = std::sqrt(static_cast<double>(count));
    for (std::uint64_t seed = 0; seed < 10; ++seed) {
        CAPTURE(seed);
        RandomStream stream(seed, RandomPurpose::reading_noise, 3);
        double u1 = 0, u2 = 0, lowest = 1, highest = 0;
        for (int i = 0; i < count; ++i) {
            const double u = stream.uniform();
            u1 += u / count;
            u2 += u * u / count;
            lowest = std::min(lowest, u);
            highest = std::max(highest, u);
        }
        CHECK(lowest > 0.0);
        CHECK(highest < 1.0);
        // Var u = 1/12, Var u^2 = 1/5 - 1/9 = 4/45.
        CHECK(std::abs(u1 - 0.5) * root < 5.0 * std::sqrt(1.0 / 12.0));
        CHECK(std::abs(u2 - 1.0 / 3.0) * root < 5.0 * std::sqrt(4.0 / 45.0));

        double n1 = 0, n2 = 0, n4 = 0, pairs = 0, previous = 0;
        for (int i = 0; i < count; ++i) {
            const double x = stream.normal();
            n1 += x / count;
            n2 += x * x / count;
            n4 += x * x * x * x / count;
            pairs += x * previous / count;
            previous = x;
        }
        // Var x = 1, Var x^2 = 2, Var x^4 = 105 - 9 = 96, Var(x y) = 1.
        CHECK(std::abs(n1) * root < 5.0);
        CHECK(std::abs(n2 - 1.0) * root < 5.0 * std::sqrt(2.0));
        CHECK(std::abs(n4 - 3.0) * root < 5.0 * std::sqrt(96.0));
        CHECK(std::abs(pairs) * root < 5.0);
    }
}

TEST_CASE("normal numbers have the normal distribution", "[estimator]") {
    // Kolmogorov's distance times sqrt(count) exceeds 2.2 with probability 1.3e-4.
    constexpr int count = 100000;
    RandomStream stream(5, RandomPurpose::reading_noise, 0);
    std::vector<double> x(count);
    for (double& value : x)
        value = stream.normal();
    std::sort(x.begin(), x.end());
    double distance = 0;
    for (int i = 0; i < count; ++i) {
        const double p = 0.5 * std::erfc(-x[static_cast<std::size_t>(i)] / std::sqrt(2.0));
        distance = std::max(
            {distance, std::abs(p - static_cast<double>(i) / count), std::abs(p - static_cast<double>(i + 1) / count)});
    }
    CHECK(distance * std::sqrt(static_cast<double>(count)) < 2.2);
}

}  // namespace random_stream_test

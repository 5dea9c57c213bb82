#include <chrono>
#include <cstring>
#include <optional>
#include <span>
#include <stdexcept>
#include <thread>

#include "estimator/ranks/thread_ranks.hpp"
#include "tests/catch.hpp"

using namespace orbid::estimator;
using std::chrono::milliseconds;

namespace {

std::span<const std::byte> bytes(const int& number) {
    return std::as_bytes(std::span(&number, 1));
}

int number(const RankMessage& message) {
    int value = 0;
    REQUIRE(message.content.size() == sizeof value);
    std::memcpy(&value, message.content.data(), sizeof value);
    return value;
}

}  // namespace

TEST_CASE("Threads as ranks: messages of each rank arrive in order, from one rank or from any", "[ranks]") {
    ThreadRanks ranks(3);
    CHECK(ranks[2].rank() == 2);
    CHECK(ranks[2].count() == 3);
    std::thread first([&] {
        for (int k = 0; k < 100; ++k)
            ranks[1].send(0, bytes(k));
        ranks.end(1);
    });
    std::thread second([&] {
        const int twice = 2 * number(ranks[2].receive(0));
        ranks[2].send(0, bytes(twice));
    });
    const int asked = 21;
    ranks[0].send(2, bytes(asked));
    CHECK(number(ranks[0].receive(2)) == 42);
    for (int k = 0; k < 100; ++k)
        CHECK(number(ranks[0].receive(Ranks::any)) == k);
    CHECK(ranks[0].receive(1).lost);
    CHECK_FALSE(ranks[0].receive(Ranks::any, milliseconds(1)));
    first.join();
    second.join();
}

TEST_CASE("Threads as ranks: there is at least one", "[ranks]") {
    CHECK_THROWS_AS(ThreadRanks(0), std::invalid_argument);
}

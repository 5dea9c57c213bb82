#include "models/system/left_loop.hpp"

#include <algorithm>
#include <atomic>
#include <stdexcept>
#include <vector>

#include <oneapi/tbb/parallel_for.h>

#include "tests/catch.hpp"

namespace orbid::left_loop_test {
namespace {

TEST_CASE("an inner loop that an outer one leaves is not taken for a whole one", "[models][threads]") {
    std::atomic<int> whole = 0, left = 0, broken = 0;
    for (int repetition = 0; repetition < 200; ++repetition) {
        const auto outer = [&](int i) {
            if (i == 3) throw std::invalid_argument("the outer loop is left");
            std::vector<int> slots(64, 0);
            try {
                oneapi::tbb::parallel_for(0, 64, [&](int k) { slots[static_cast<std::size_t>(k)] = 1; });
                models::stop_if_left();
            } catch (const models::Stopped&) {
                ++left;
                return;
            }
            const bool filled = std::count(slots.begin(), slots.end(), 1) == 64;
            ++(filled ? whole : broken);
        };
        CHECK_THROWS_AS(oneapi::tbb::parallel_for(0, 32, outer), std::invalid_argument);
    }
    CHECK(broken == 0);
    CHECK(whole + left > 0);
    // Alone, and within a loop that goes to its end, nothing is left.
    CHECK_NOTHROW(models::stop_if_left());
    CHECK_NOTHROW(oneapi::tbb::parallel_for(0, 8, [](int) { models::stop_if_left(); }));
}

}  // namespace
}  // namespace orbid::left_loop_test

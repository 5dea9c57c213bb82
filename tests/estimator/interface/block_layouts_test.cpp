// Sets that share their blocks do not see each other's changes.

#include "estimator/interface/residual.hpp"
#include "tests/catch.hpp"

namespace orbid::tests::block_layouts_test {

TEST_CASE("copies of blocks are shared until one of them is changed", "[estimator]") {
    estimator::BlockLayout block;
    block.label = "first";
    estimator::BlockLayouts blocks = {block, block};
    estimator::BlockLayouts copy = blocks;
    CHECK(&copy[0] == &blocks[0]);
    copy.edit()[0].active = false;
    CHECK(&copy[0] != &blocks[0]);
    CHECK(blocks[0].active);
    CHECK_FALSE(copy[0].active);
    // A set of its own is not copied again.
    const estimator::BlockLayout* const own = &copy[0];
    copy.edit()[1].label = "second";
    CHECK(&copy[0] == own);
    CHECK(blocks[1].label == "first");
    CHECK(copy.back().label == "second");
}

TEST_CASE("blocks that were never given are none", "[estimator]") {
    estimator::BlockLayouts none;
    CHECK(none.empty());
    CHECK(none.begin() == none.end());
    const estimator::BlockLayouts still = none;
    none.edit().emplace_back().label = "new";
    CHECK(none.size() == 1);
    CHECK(still.empty());
    const std::vector<estimator::BlockLayout>& as_vector = none;
    CHECK(as_vector.front().label == "new");
}

}  // namespace orbid::tests::block_layouts_test

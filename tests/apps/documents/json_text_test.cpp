#include "apps/documents/json_text.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

#include "tests/catch.hpp"

namespace orbid::json_text_test {
namespace {

using Json = nlohmann::ordered_json;

TEST_CASE("numbers read back to the bit", "[apps]") {
    // Bit patterns from a linear congruential generator (Knuth's MMIX constants) cover all exponents.
    std::uint64_t bits = 1;
    int tested = 0;
    for (int i = 0; i < 20000; ++i) {
        bits = bits * 6364136223846793005ULL + 1442695040888963407ULL;
        const double value = std::bit_cast<double>(bits);
        if (std::isfinite(value)) {
            const double back = Json::parse(apps::json_text(Json(value))).get<double>();
            REQUIRE(std::bit_cast<std::uint64_t>(back) == bits);
            ++tested;
        }
    }
    CHECK(tested > 19000);
    for (const double value : {0.0, -0.0, 0.1, 1.0, 1e300, std::numeric_limits<double>::denorm_min(),
                               std::numeric_limits<double>::max(), 0.317}) {
        CHECK(std::bit_cast<std::uint64_t>(Json::parse(apps::json_text(Json(value))).get<double>()) ==
              std::bit_cast<std::uint64_t>(value));
    }
}

TEST_CASE("undefined numbers are null", "[apps]") {
    CHECK(apps::json_text(Json(std::numeric_limits<double>::quiet_NaN())) == "null\n");
    CHECK(apps::json_text(Json(-std::numeric_limits<double>::infinity())) == "null\n");
}

TEST_CASE("what fits on a line stands on a line", "[apps]") {
    CHECK(apps::json_text(Json{{"a", 1}, {"b", {1.5, 2.5}}, {"c", Json::object()}}) ==
          "{\"a\": 1, \"b\": [1.5, 2.5], \"c\": {}}\n");
    const std::string filler(100, 'x');
    CHECK(apps::json_text(Json{{"text", filler}, {"list", {1, 2, 3}}, {"empty", Json::array()}}) ==
          "{\n  \"text\": \"" + filler + "\",\n  \"list\": [1, 2, 3],\n  \"empty\": []\n}\n");
}

TEST_CASE("a long list of numbers stays on its line, a matrix is broken by rows", "[apps]") {
    Json row = Json::array();
    for (int i = 0; i < 100; ++i) {
        row.push_back(i);
    }
    const std::string line = apps::json_text(row);
    CHECK(std::count(line.begin(), line.end(), '\n') == 1);
    const std::string matrix = apps::json_text(Json::array({row, row}));
    CHECK(std::count(matrix.begin(), matrix.end(), '\n') == 4);
    CHECK(Json::parse(matrix) == Json::array({row, row}));
}

TEST_CASE("text that is not UTF-8 does not stop a result from being written", "[apps]") {
    CHECK(Json::parse(apps::json_text(Json{{"title", "caf\xe9"}}))["title"] == "caf\xef\xbf\xbd");
}

}  // namespace
}  // namespace orbid::json_text_test

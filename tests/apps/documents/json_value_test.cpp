#include "apps/documents/json_value.hpp"

#include <cstddef>
#include <limits>
#include <string>
#include <vector>

#include "tests/catch.hpp"

namespace json_value_test {

using orbid::apps::json_value;
using orbid::apps::whole_number;
using orbid::apps::whole_numbers;

namespace {

/// Whether a text is a whole number in the range of an int.
bool is_int(const std::string& text) {
    try {
        (void)whole_number<int>(json_value(text));
        return true;
    } catch (const nlohmann::json::type_error&) {
        return false;
    }
}

}  // namespace

TEST_CASE("whole numbers of JSON are those of the integer's range", "[apps][json]") {
    CHECK(whole_number<int>(json_value("-2147483648")) == std::numeric_limits<int>::min());
    CHECK(whole_number<int>(json_value("2147483647")) == std::numeric_limits<int>::max());
    CHECK(whole_number<std::size_t>(json_value("18446744073709551615")) == std::numeric_limits<std::size_t>::max());
    for (const char* other : {"2147483648", "-2147483649", "18446744073709551615", "1e103", "0.5", "2.0", "null",
                              "true", "\"1\"", "[1]", "{}"}) {
        CAPTURE(other);
        CHECK_FALSE(is_int(other));
    }
    CHECK_THROWS_AS(whole_number<std::size_t>(json_value("-1")), nlohmann::json::type_error);
}

TEST_CASE("lists of whole numbers hold nothing else", "[apps][json]") {
    CHECK(whole_numbers<int>(json_value("[1, -2, 3]")) == std::vector<int>{1, -2, 3});
    CHECK(whole_numbers<int>(json_value("[]")).empty());
    for (const char* other : {"1", "null", "{\"a\": 1}", "[1, 0.5]", "[[1]]", "[1e103]"}) {
        CAPTURE(other);
        CHECK_THROWS_AS(whole_numbers<int>(json_value(other)), nlohmann::json::type_error);
    }
}

}  // namespace json_value_test

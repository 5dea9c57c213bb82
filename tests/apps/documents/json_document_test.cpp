#include "apps/documents/json_document.hpp"

#include <string>

#include "tests/catch.hpp"

namespace json_document_test {

using namespace orbid::apps;
using orbid::tests::ContainsSubstring;

TEST_CASE("every value knows its place", "[apps][json]") {
    const auto document = parse_json("// note\n{\n  \"a\": 1.5, /* two\nlines */ \"b\": [true, null,\n \"x\\\"y\"]\n}");
    REQUIRE(document.root);
    REQUIRE(document.problems.empty());
    const JsonValue& root = *document.root;
    CHECK(root.place.line == 2);
    REQUIRE(root.members.size() == 2);
    CHECK(root.members[0].place.line == 3);
    CHECK(root.members[0].place.column == 3);
    CHECK(root.members[0].value.number == 1.5);
    CHECK(root.members[0].value.place.column == 8);
    CHECK(root.members[1].place.line == 4);
    REQUIRE(root.members[1].value.items.size() == 3);
    CHECK(root.members[1].value.items[2].place.line == 5);
    CHECK(root.members[1].value.items[2].text == "x\"y");
}

TEST_CASE("duplicate keys are named with both lines", "[apps][json]") {
    const auto document = parse_json("{\n\"a\": 1,\n\"b\": { \"c\": 1,\n \"c\": 2 },\n\"a\": 3 }");
    REQUIRE(document.problems.size() == 2);
    CHECK(message(document.problems[0], "job.json") ==
          "job.json:4:2: /b/c: duplicate key, first given in line 3, column 8");
    CHECK(message(document.problems[1], "job.json") ==
          "job.json:5:1: /a: duplicate key, first given in line 2, column 1");
}

TEST_CASE("text that is no JSON is refused with its place", "[apps][json]") {
    const auto refusal = [](const std::string& text) {
        const auto document = parse_json(text);
        CHECK_FALSE(document.root);
        REQUIRE(document.problems.size() == 1);
        return message(document.problems[0], "f");
    };
    CHECK_THAT(refusal(""), ContainsSubstring("f:1:1: the file is empty"));
    CHECK_THAT(refusal("{\n \"a\" 1}"), ContainsSubstring("f:2:6: ") && ContainsSubstring("expected ':'"));
    CHECK_THAT(refusal("{\"a\": 1,}"), ContainsSubstring("expected string literal"));
    CHECK_THAT(refusal("{\"a\": nan}"), ContainsSubstring("invalid literal"));
    CHECK_THAT(refusal("{\"a\":\n1e999}"), ContainsSubstring("f:2:1:") && ContainsSubstring("number overflow"));
    CHECK_THAT(refusal("{\"a\": \"\xff\"}"), ContainsSubstring("ill-formed UTF-8"));
    CHECK_THAT(refusal("{} x"), ContainsSubstring("expected end of input"));
    CHECK_THAT(refusal(std::string(100, '[') + std::string(100, ']')), ContainsSubstring("nested deeper than 64"));
}

TEST_CASE("pointers escape as RFC 6901 says", "[apps][json]") {
    CHECK(child_pointer("/a", "b/c~d") == "/a/b~1c~0d");
}

TEST_CASE("as many values as the limit are read, one more is refused", "[apps][json]") {
    // [0,0,...,0]: the list is a value itself.
    const auto list = [](std::size_t values) {
        std::string text = "[";
        for (std::size_t i = 1; i + 1 < values; ++i)
            text += "0,";
        return text + "0]";
    };
    CHECK(parse_json(list(most_json_values)).root);
    const auto refused = parse_json(list(most_json_values + 1));
    CHECK_FALSE(refused.root);
    REQUIRE(refused.problems.size() == 1);
    CHECK(refused.problems[0].rule == "more than 4000000 values");
}

TEST_CASE("of many keys the one that comes twice is found", "[apps][json]") {
    std::string text = "{";
    for (int i = 0; i < 100; ++i)
        text += "\"k" + std::to_string(i) + "\": 1,\n";
    const auto document = parse_json(text + "\"k70\": 2, \"k3\": 3}");
    REQUIRE(document.problems.size() == 2);
    CHECK(document.problems[0].rule == "duplicate key, first given in line 71, column 1");
    CHECK(document.problems[1].rule == "duplicate key, first given in line 4, column 1");
}

TEST_CASE("a comment ends with its line, however that ends", "[apps][json]") {
    using std::string_literals::operator""s;
    for (const std::string& text :
         {"// a\n{\"k\": 1}"s, "// a\r{\"k\": 1}"s, "// a\r\n{\"k\": 1}"s, "// a\0{\"k\": 1}"s}) {
        const auto document = parse_json(text);
        REQUIRE(document.root);
        REQUIRE(document.root->members.size() == 1);
        CHECK(document.root->members[0].key == "k");
    }
    CHECK_FALSE(parse_json("///{/{pl\0"s + "5pl5").root);
}

TEST_CASE("nesting is counted outside of strings and comments", "[apps][json]") {
    const std::string deep(deepest_json, '[');
    CHECK_FALSE(is_nested_too_deep(deep));
    CHECK(is_nested_too_deep(deep + "["));
    CHECK(is_nested_too_deep(deep + "{"));
    CHECK(is_nested_too_deep("/* \" */" + deep + "["));
    CHECK(is_nested_too_deep("// \"\n" + deep + "["));
    CHECK(is_nested_too_deep("\"\\\"\"" + deep + "["));
    CHECK_FALSE(is_nested_too_deep("\"" + deep + "[\""));
    CHECK_FALSE(is_nested_too_deep("/*" + deep + "[*/ 1"));
}

}  // namespace json_document_test

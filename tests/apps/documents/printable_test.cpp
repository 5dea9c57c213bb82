#include "apps/documents/printable.hpp"

#include <sstream>
#include <string>

#include "tests/catch.hpp"

namespace orbid::printable_test {
namespace {

using apps::printable;
using apps::visible;

TEST_CASE("text that does nothing but show itself stays as it is", "[apps]") {
    for (const char* text :
         {"", "plain", "two\nlines\tand a tab", "grün, 東京, \xF0\x9F\x98\x80", "<b> & \"quotes\" \\x1b"}) {
        CHECK(printable(text) == text);
        CHECK(visible(text) == text);
    }
}

TEST_CASE("what a terminal would obey is escaped", "[apps]") {
    CHECK(printable("\x1b[2J\x1b]0;x\x07") == "\\u001b[2J\\u001b]0;x\\u0007");
    CHECK(printable("good\rbad\b") == "good\\u000dbad\\u0008");
    CHECK(printable("a\x7f") == "a\\u007f");
    CHECK(printable("\xC2\x9B"
                    "31m") == "\\u009b31m");  // the control sequence introducer of C1
    CHECK(printable("\xE2\x80\xAE"
                    "gpj.exe\xE2\x81\xA9") == "\\u202egpj.exe\\u2069");  // right-to-left override
    CHECK(printable(std::string_view("a\0b", 3)) == "a\\u0000b");
    CHECK(visible("\x1b[2J\rx\xE2\x80\xAEy") == "[2Jxy");
}

TEST_CASE("bytes that are not UTF-8 are escaped one by one", "[apps]") {
    // A byte that continues nothing, an overlong slash, a surrogate, one beyond U+10FFFF, a character cut off.
    CHECK(printable("\x80") == "\\x80");
    CHECK(printable("\xC0\xAF") == "\\xc0\\xaf");
    CHECK(printable("\xE0\x80\xAF") == "\\xe0\\x80\\xaf");
    CHECK(printable("\xED\xA0\x80") == "\\xed\\xa0\\x80");
    CHECK(printable("\xF4\x90\x80\x80") == "\\xf4\\x90\\x80\\x80");
    CHECK(printable("a\xE6\x9D") == "a\\xe6\\x9d");
    CHECK(visible("a\xFFz") == "a\xEF\xBF\xBDz");
}

TEST_CASE("a stream escapes the same, however a character is divided", "[apps]") {
    const std::string text = "東\x1b[31m\xFF京\xE2\x80\xAE";
    for (std::size_t piece = 1; piece <= text.size(); ++piece) {
        std::ostringstream target;
        {
            apps::PrintableStream stream(target);
            for (std::size_t at = 0; at < text.size(); at += piece)
                stream << text.substr(at, piece);
        }
        CHECK(target.str() == printable(text));
    }
}

TEST_CASE("colours and pictures pass by the filter, in order", "[apps]") {
    std::ostringstream target;
    {
        apps::PrintableStream stream(target);
        stream << "a\x1b";
        apps::write_unfiltered(stream, "\x1b[0m");
        stream << "b";
    }
    CHECK(target.str() == "a\\u001b\x1b[0mb");
    std::ostringstream plain;
    apps::write_unfiltered(plain, "\x1b[0m");
    CHECK(plain.str() == "\x1b[0m");
}

}  // namespace
}  // namespace orbid::printable_test

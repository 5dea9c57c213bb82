#include "apps/documents/fingerprint.hpp"

#include <fstream>
#include <stdexcept>
#include <string>

#include "tests/apps/program/temporary_folder.hpp"
#include "tests/catch.hpp"

namespace orbid::fingerprint_test {
namespace {

using tests::ContainsSubstring;
using tests::TemporaryFolder;

// FIPS 180-4 examples published by NIST (SHA256.pdf and the long-message example).
constexpr const char* hash_of_nothing = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
constexpr const char* hash_of_abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
constexpr const char* hash_of_two_blocks = "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1";
constexpr const char* hash_of_a_million_a = "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0";

TEST_CASE("SHA-256 of the published examples", "[apps][reference]") {
    CHECK(apps::sha256("") == hash_of_nothing);
    CHECK(apps::sha256("abc") == hash_of_abc);
    CHECK(apps::sha256("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq") == hash_of_two_blocks);
    CHECK(apps::sha256(std::string(1'000'000, 'a')) == hash_of_a_million_a);
}

TEST_CASE("SHA-256 of files, longer than a buffer and empty", "[apps][reference]") {
    const TemporaryFolder folder;
    std::ofstream(folder.path() / "empty").close();
    CHECK(apps::sha256_of_file(folder.path() / "empty") == hash_of_nothing);
    const std::string long_text(5'000'000, 'x');
    std::ofstream(folder.path() / "long") << long_text;
    CHECK(apps::sha256_of_file(folder.path() / "long") == apps::sha256(long_text));
    CHECK_THROWS_WITH(apps::sha256_of_file(folder.path() / "absent"),
                      ContainsSubstring("absent") && ContainsSubstring("No such file"));
    CHECK_THROWS_AS(apps::sha256_of_file(folder.path()), std::runtime_error);
}

TEST_CASE("fingerprints name the first key that differs", "[apps]") {
    const auto stored = apps::fingerprint({{"/model/name", "\"duffing\""}, {"/seed", "1"}, {"/data", "{}"}});
    CHECK_FALSE(apps::compare(stored, stored));

    const auto other =
        apps::compare(stored, apps::fingerprint({{"/model/name", "\"duffing\""}, {"/seed", "2"}, {"/data", "[]"}}));
    REQUIRE(other);
    CHECK(apps::description(*other) == "/seed is 1 in the file, 2 in the job");

    const auto missing = apps::compare(stored, apps::fingerprint({{"/model/name", "\"duffing\""}, {"/seed", "1"}}));
    REQUIRE(missing);
    CHECK(apps::description(*missing) == "/data is {} in the file, absent in the job");

    auto more = stored.keys;
    more.emplace_back("/section", "0");
    const auto added = apps::compare(stored, apps::fingerprint(more));
    REQUIRE(added);
    CHECK(apps::description(*added) == "/section is absent in the file, 0 in the job");
}

TEST_CASE("moving characters between key and value changes the hash", "[apps]") {
    CHECK(apps::fingerprint({{"ab", "c"}}).sha256 != apps::fingerprint({{"a", "bc"}}).sha256);
    CHECK(apps::fingerprint({{"a", "1"}, {"b", "2"}}).sha256 != apps::fingerprint({{"b", "2"}, {"a", "1"}}).sha256);
    CHECK(apps::fingerprint({}).sha256 == hash_of_nothing);
}

TEST_CASE("a fingerprint survives as text, a damaged one does not", "[apps]") {
    const auto stored = apps::fingerprint({{"/title", "\"quotes \\\" and\\nlines\""}, {"/seed", "1"}});
    const std::string text = apps::to_text(stored);
    CHECK(text.find('\n') == std::string::npos);
    const auto read = apps::fingerprint_from_text(text);
    REQUIRE(read);
    CHECK(read->sha256 == stored.sha256);
    CHECK(read->keys == stored.keys);

    auto damaged = stored;
    damaged.keys[1].second = "2";
    CHECK_FALSE(apps::fingerprint_from_text(apps::to_text(damaged)));
    CHECK_FALSE(apps::fingerprint_from_text("{\"sha256\": 1}"));
    CHECK_FALSE(apps::fingerprint_from_text("no JSON"));
}

TEST_CASE("a key given twice is refused", "[apps]") {
    CHECK_THROWS_WITH(apps::fingerprint({{"/seed", "1"}, {"/seed", "2"}}),
                      ContainsSubstring("/seed") && ContainsSubstring("unique"));
}

}  // namespace
}  // namespace orbid::fingerprint_test

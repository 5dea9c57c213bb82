// Valid and broken jobs and data files of tests/apps/jobs: each fault is named with its place, its rule and the right
// exit code. job_schema.py compares the same jobs with the schema, by an independent validator.

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <vector>

#include "apps/documents/json_reader.hpp"
#include "apps/documents/schema_check.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/reading/job_reader.hpp"
#include "apps/program/command_schema.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace job_corpus_test {

using namespace orbid;
using namespace orbid::apps;
using tests::Path;

namespace {

const Path corpus = orbid::tests::source_folder() + "/tests/apps/jobs";

/// The rows of a table whose cells are separated by " | "; lines that begin with # are left out.
std::vector<std::vector<std::string>> rows(const Path& file) {
    std::vector<std::vector<std::string>> result;
    std::ifstream in(file);
    for (std::string line; std::getline(in, line);) {
        if (line.starts_with("#")) continue;
        std::vector<std::string> cells;
        for (std::size_t at = 0; at != std::string::npos;) {
            // An empty cell leaves "| |" of its two separators.
            const std::size_t end = line.find('|', at);
            std::string cell = line.substr(at, end == std::string::npos ? end : end - at);
            cell.erase(0, std::min(cell.find_first_not_of(' '), cell.size()));
            cell.erase(cell.find_last_not_of(' ') + 1);
            cells.push_back(cell);
            at = end == std::string::npos ? end : end + 1;
        }
        result.push_back(std::move(cells));
    }
    return result;
}

std::vector<Path> jobs_in(const Path& folder) {
    std::vector<Path> files;
    for (const auto& entry : std::filesystem::directory_iterator(folder))
        if (entry.path().extension() == ".json") files.push_back(entry.path());
    std::sort(files.begin(), files.end());
    return files;
}

/// Notes which described keys a document has, as PATH.KEY; what is shared counts under its name.
void note_keys(const JsonValue& value, const ValueSchema& description, std::string path, std::set<std::string>& keys) {
    if (!description.name.empty()) path = description.name;
    if (description.list) {
        for (const JsonValue& item : value.items)
            note_keys(item, *description.list->item, path + "[]", keys);
    }
    if (!description.object) return;
    if (!description.object_name.empty()) path = description.object_name;
    for (const JsonMember& member : value.members) {
        const KeySchema* key = description.object->find(member.key);
        const std::string below = path + "." + (key != nullptr ? member.key : "NAME");
        if (key != nullptr) keys.insert(below);
        if (const ValueSchema* inner = description.object->value_of(member.key))
            note_keys(member.value, *inner, below, keys);
    }
}

void all_keys(const ValueSchema& description, std::string path, std::set<std::string>& keys) {
    if (!description.name.empty()) path = description.name;
    if (description.list) all_keys(*description.list->item, path + "[]", keys);
    if (!description.object) return;
    if (!description.object_name.empty()) path = description.object_name;
    for (const KeySchema& key : description.object->keys) {
        if (!key.refused.empty()) continue;
        keys.insert(path + "." + key.key);
        all_keys(key.value, path + "." + key.key, keys);
    }
    if (description.object->entries) all_keys(*description.object->entries->value, path + ".NAME", keys);
}

}  // namespace

TEST_CASE("every valid job is read, and together they have every key there is", "[apps][job][corpus]") {
    std::set<std::string> seen;
    std::vector<Path> files = jobs_in(corpus / "valid");
    const std::vector<Path> configs = jobs_in(orbid::tests::source_folder() + "/configs");
    files.insert(files.end(), configs.begin(), configs.end());
    REQUIRE(files.size() > 30);
    for (const Path& file : files) {
        CAPTURE(file);
        const JobReading reading = read_job_file(file);
        for (const Problem& problem : reading.problems)
            UNSCOPED_INFO(message(problem, file.filename().string()));
        CHECK(reading.exit_code() == 0);
        const JsonDocument document = parse_json(read_whole_file(file));
        note_keys(*document.root, job_description(), "", seen);
    }
    // A key that is described and not read makes the reader of such a job throw.
    std::set<std::string> described;
    all_keys(job_description(), "", described);
    std::vector<std::string> missing;
    std::set_difference(described.begin(), described.end(), seen.begin(), seen.end(), std::back_inserter(missing));
    CAPTURE(missing);
    CHECK(missing.empty());
}

TEST_CASE("what is wrong with a broken job is named once, with line, column and rule", "[apps][job][corpus]") {
    const auto table = rows(corpus / "broken.txt");
    CHECK(table.size() >= 60);
    CHECK(table.size() == jobs_in(corpus / "broken").size());
    for (const auto& row : table) {
        CAPTURE(row);
        REQUIRE(row.size() == 6);
        const Path file = corpus / "broken" / (row[0] + ".json");
        const tests::Outcome check = tests::orbid_with({"check", file});
        CHECK(std::to_string(check.code) == row[2]);
        CHECK(check.out.empty());
        CHECK(std::count(check.error.begin(), check.error.end(), '\n') == 1);
        const std::string place = file.string() + ":" + row[3] + ": " + row[4] + (row[4].empty() ? "" : ": ");
        CHECK_THAT(check.error, Catch::Matchers::StartsWith(place) && tests::ContainsSubstring(row[5]));
    }
}

TEST_CASE("data that cannot be used are named with their place", "[apps][data][corpus]") {
    const auto table = rows(corpus / "bad_data.txt");
    CHECK(table.size() >= 20);
    for (const auto& row : table) {
        CAPTURE(row);
        REQUIRE(row.size() == 4);
        const tests::TemporaryFolder folder;
        const Path data = corpus / "bad_data" / row[0];
        std::filesystem::copy_file(data, folder.path() / ("data" + data.extension().string()));
        std::filesystem::copy_file(corpus / "bad_data" / ("job_" + row[1] + ".json"), folder.path() / "job.json");
        const tests::Outcome run = tests::orbid_with({"run", folder.path() / "job.json", "--quiet"});
        CHECK(run.code == 3);
        CHECK(run.out.empty());
        CHECK(std::count(run.error.begin(), run.error.end(), '\n') == 1);
        CHECK_THAT(run.error, tests::ContainsSubstring(row[2]) && tests::ContainsSubstring(row[3]));
        CHECK_FALSE(std::filesystem::exists(folder.path() / "job"));
    }
}

TEST_CASE("all problems of a job are reported at once, by place", "[apps][job][corpus]") {
    const auto reading = read_job(R"({
  "model": { "name": "henon", "paramters": { } },
  "seed": -1, "title": 3,
  "data": { "simulate": { "sections": 100, "initial": [[0.1]] } }
})",
                                  corpus / "job.json");
    std::vector<std::string> found;
    for (const Problem& problem : reading.problems)
        found.push_back(message(problem, "job.json"));
    CAPTURE(found);
    REQUIRE(found.size() == 4);
    CHECK_THAT(found[0], Catch::Matchers::StartsWith("job.json:2:31: /model/paramters: unknown key; did you mean"));
    CHECK_THAT(found[1], Catch::Matchers::StartsWith("job.json:3:11: /seed: must be a whole number"));
    CHECK_THAT(found[2], Catch::Matchers::StartsWith("job.json:3:24: /title: must be a text, not 3"));
    CHECK_THAT(found[3],
               Catch::Matchers::StartsWith("job.json:4:56: /data/simulate/initial/0: must be a state of 2 numbers"));
}

TEST_CASE("a key is neither read in secret nor accepted and ignored", "[apps][job][corpus]") {
    using namespace describe;
    const ValueSchema description = object({key("a", number(), "A."), key("b", choice({"x", "y"}), "B.")});
    JsonDocument document = parse_json(R"({ "a": 1, "b": "x" })");
    std::vector<Problem> problems;
    check_described(*document.root, description, problems);
    REQUIRE(problems.empty());
    ObjectReader reader(ValueReader(*document.root, "", problems, &description));
    CHECK_THROWS_WITH(reader.find("c"), "the key /c is read and not described");
    REQUIRE(reader.find("a"));
    CHECK_THROWS_WITH(reader.finish(), "the key /b is described and not read");
    const auto b = reader.find("b");
    REQUIRE(b);
    CHECK_NOTHROW(reader.finish());
    CHECK(b->choice({"x", "y"}) == 0U);
    CHECK_THROWS_WITH(b->choice({"x", "z"}), "other choices are described than read at /b");
}

TEST_CASE("schema and reference are what is described, and those in docs are current", "[apps][job][corpus]") {
    const std::string schema = job_schema_text();
    CHECK(schema == job_schema_text());
    const auto document = tests::json::parse(schema);
    CHECK(document["$schema"] == "https://json-schema.org/draft/2020-12/schema");
    CHECK(document["properties"]["orbits"]["properties"]["box"]["exclusiveMaximum"] == 0.5);
    CHECK(document["properties"]["output"]["properties"]["series"]["default"] == "h5");
    const Path docs = orbid::tests::source_folder() + "/docs";
    // Written anew by: orbid schema > docs/orbid-job.schema.json; orbid schema --markdown > docs/job_reference.md
    CHECK((read_whole_file(docs / "orbid-job.schema.json") == schema));
    CHECK((read_whole_file(docs / "job_reference.md") == job_reference_text()));
    CHECK(tests::orbid_with({"schema"}).out == schema);
    CHECK(tests::orbid_with({"schema", "--markdown"}).out == job_reference_text());
}

}  // namespace job_corpus_test

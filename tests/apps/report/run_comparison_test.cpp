#include "apps/report/run_comparison.hpp"

#include <functional>
#include <regex>

#include "tests/apps/stored_run/stored_folder.hpp"
#include "tests/catch.hpp"

namespace run_comparison_test {

using namespace orbid::apps;
using namespace orbid::tests;

namespace {

void edit(const Path& file, const std::function<void(json&)>& change) {
    json content = read_json(file);
    change(content);
    write_job(file, content);
}

}  // namespace

TEST_CASE("two runs are compared in sds of the difference", "[apps][compare]") {
    const TemporaryFolder folder;
    const Path first = folder.path() / "a";
    const Path second = folder.path() / "b";
    write_stored_run(first, 1.40, 0.03);
    write_stored_run(second, 1.45, 0.04);
    edit(second / "job.json", [](json& job) { job["seed"] = 7; });
    const Outcome compared = orbid_with({"compare", first, second});
    CHECK(compared.code == 0);
    // (1.45 - 1.40) / sqrt(0.03^2 + 0.04^2) = 1.
    CHECK_THAT(compared.out, ContainsSubstring("1.400 ± 0.03") && ContainsSubstring("1.450 ± 0.04") &&
                                 ContainsSubstring("0.05") && ContainsSubstring("+1.00"));
    CHECK_THAT(compared.out, ContainsSubstring("/seed") && ContainsSubstring("series.x"));
    // Other seeds are other data: no correlation, no evidence.
    CHECK_THAT(compared.out, !ContainsSubstring("same data") && !ContainsSubstring("Bayes"));
    // Both lists hold both cycles.
    CHECK_THAT(compared.out, ContainsSubstring("Measured cycles"));
}

TEST_CASE("runs on the same data say so, and their evidences are compared", "[apps][compare]") {
    const TemporaryFolder folder;
    const Path first = folder.path() / "a";
    const Path second = folder.path() / "b";
    write_stored_run(first, 1.40, 0.03);
    write_stored_run(second, 1.45, 0.04);
    edit(second / "result.json", [](json& result) {
        result["log_evidence"]["value"] = -16.0;
        result["objective"] = 14.0;
    });
    const std::string text = orbid_with({"compare", first, second}).out;
    CHECK_THAT(text, ContainsSubstring("both rest on the same data"));
    CHECK_THAT(text, ContainsSubstring("objective of the second less that of the first: 4"));
    // -12 - (-16) = 4 is strong (3 to 5).
    CHECK_THAT(text, ContainsSubstring("first against the second: 4; strongly supported: the first"));
}

TEST_CASE("cycles are matched whatever point they begin with", "[apps][compare]") {
    const TemporaryFolder folder;
    const Path first = folder.path() / "a";
    const Path second = folder.path() / "b";
    for (const Path& run : {first, second}) {
        write_stored_run(run);
        std::filesystem::remove(run / "result.json");
    }
    edit(second / "cycles.json", [](json& cycles) {
        auto& points = cycles["cycles"][1]["points"];
        std::swap(points[0], points[1]);
        // Off by 0.003 of a range of 1.45: the same cycle; the fixed point by 0.5: another one.
        points[0][0] = points[0][0].get<double>() + 0.003;
        cycles["cycles"][0]["points"][0][0] = 0.1;
    });
    const std::string text = orbid_with({"compare", first, second}).out;
    CHECK(std::regex_search(text, std::regex("\n +1 +1 +1 +0\n")));
    CHECK(std::regex_search(text, std::regex("\n +2 +1 +1 +1 +0\\.0021\n")));
}

TEST_CASE("what is not comparable is refused with what there is", "[apps][compare]") {
    const TemporaryFolder folder;
    const Path first = folder.path() / "a";
    const Path second = folder.path() / "b";
    write_stored_run(first);
    write_stored_run(second);
    for (const char* name : {"result.json", "cycles.json"})
        std::filesystem::remove(second / name);
    const Outcome outcome = orbid_with({"compare", first, second});
    CHECK(outcome.code == 2);
    CHECK(outcome.out.empty());
    CHECK_THAT(outcome.error, ContainsSubstring("nothing to compare") &&
                                  ContainsSubstring("henon, with an estimate, measured cycles") &&
                                  ContainsSubstring("henon, with no results"));
    CHECK(orbid_with({"compare", first, folder.path() / "none"}).code == 2);
    CHECK(orbid_with({"compare", first}).code == 2);
}

}  // namespace run_comparison_test

#include <cmath>
#include <limits>
#include <random>

#include "apps/documents/atomic_file.hpp"
#include "apps/drawing/markup_text.hpp"
#include "apps/report/base64_text.hpp"
#include "apps/report/html_text.hpp"
#include "apps/report/report_chart.hpp"
#include "apps/report/report_points.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/apps/stored_run/stored_folder.hpp"
#include "tests/catch.hpp"

namespace report_test {

using namespace orbid::apps;
using namespace orbid::tests;

namespace {

constexpr double undefined = std::numeric_limits<double>::quiet_NaN();

/// Inverse of base64_text, written from the RFC.
std::vector<unsigned> bytes_of(const std::string& text) {
    const std::string letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::vector<unsigned> bytes;
    unsigned bits = 0;
    int count = 0;
    for (const char c : text) {
        if (c == '=') break;
        bits = (bits << 6U) | static_cast<unsigned>(letters.find(c));
        count += 6;
        if (count >= 8) {
            count -= 8;
            bytes.push_back((bits >> static_cast<unsigned>(count)) & 255U);
        }
    }
    return bytes;
}

bool contains(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
}

std::size_t count_of(const std::string& text, const std::string& part) {
    std::size_t count = 0;
    for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1))
        ++count;
    return count;
}

}  // namespace

TEST_CASE("text for HTML cannot leave its place", "[apps][report]") {
    CHECK(markup_text("a < b & c > \"d\" 'e'") == "a &lt; b &amp; c &gt; &quot;d&quot; &#39;e&#39;");
    CHECK(markup_text("line\nnext\ttab\x01\x7f") == "line\nnext\ttab");
    CHECK(markup_text("\u03c6") == "\u03c6");
    SummaryTable table({left_aligned("<head>"), "number"});
    CHECK(html_table("<caption>", table).empty());
    table.add({"</td>", {"1 %", 0.01}});
    const std::string html = html_table("<caption>", table);
    CHECK(contains(html, "&lt;caption&gt;</caption>"));
    CHECK(contains(html, "<th scope=\"row\">&lt;/td&gt;</th><td class=\"n\" data-value=\"0.01\">1 %</td>"));
    CHECK_THROWS_WITH(table.add({"one"}), "table: 1 cells, must be 2, one per column");
}

TEST_CASE("a table leaves empty columns out, and sorts from three rows on", "[apps][report]") {
    SummaryTable table({left_aligned("a"), "b", explained("c", "explained")});
    table.add({"1", "", "2"});
    table.add({"3", "", "4"});
    CHECK(count_of(html_table("t", table), "<th scope=\"col\"") == 2);
    CHECK(contains(html_table("t", table), "<dt>c</dt><dd>explained</dd>"));
    CHECK_FALSE(contains(html_table("t", table), "sortable"));
    table.add({"5", "", "6"});
    CHECK(contains(html_table("t", table), "class=\"sortable\""));
}

TEST_CASE("base64 follows the test vectors of RFC 4648", "[apps][report]") {
    const auto encoded = [](const std::string& text) {
        return base64_text({reinterpret_cast<const unsigned char*>(text.data()), text.size()});
    };
    CHECK(encoded("").empty());
    CHECK(encoded("f") == "Zg==");
    CHECK(encoded("fo") == "Zm8=");
    CHECK(encoded("foo") == "Zm9v");
    CHECK(encoded("foobar") == "Zm9vYmFy");
    // Longer than the piece that is handed over at once.
    const std::string megabytes(7 << 20, 'x');
    const auto back = bytes_of(encoded(megabytes));
    CHECK(back.size() == megabytes.size());
    CHECK(std::all_of(back.begin(), back.end(), [](unsigned byte) { return byte == 'x'; }));
}

TEST_CASE("packed numbers: plain, even or in steps", "[apps][report]") {
    const std::vector<double> few{1.5, undefined, -2.0};
    CHECK(packed_numbers(few).dump() == "[1.5,null,-2.0]");

    std::vector<double> even;
    for (int i = 0; i < 1000; ++i)
        even.push_back(0.001 * i + 3.0);
    const auto grid = packed_numbers(even);
    CHECK(grid["count"] == 1000);
    CHECK_THAT(grid["step"].get<double>(), WithinRel(0.001, 1e-12));

    std::vector<double> rough;
    std::mt19937 random(1);
    std::normal_distribution<double> normal(2.0, 5.0);
    for (int i = 0; i < 300; ++i)
        rough.push_back(normal(random));
    rough[17] = undefined;
    const auto steps = packed_numbers(rough);
    REQUIRE(steps["bits"] == 32);
    const auto bytes = bytes_of(steps["base64"].get<std::string>());
    REQUIRE(bytes.size() == 4 * rough.size());
    const double lower = steps["lower"].get<double>();
    const double upper = steps["upper"].get<double>();
    for (std::size_t i = 0; i < rough.size(); ++i) {
        const double code =
            bytes[4 * i] + 256.0 * bytes[4 * i + 1] + 65536.0 * bytes[4 * i + 2] + 16777216.0 * bytes[4 * i + 3];
        if (i == 17) {
            CHECK(code == 4294967295.0);
            continue;
        }
        // Half a step, by construction.
        CHECK(std::abs(lower + (upper - lower) * code / 4294967294.0 - rough[i]) <=
              0.51 * (upper - lower) / 4294967294.0);
    }

    CHECK(packed_numbers(std::vector<double>(70000, 1.0))["bits"] == 16);
    const auto nothing = packed_numbers(std::vector<double>(100, undefined));
    CHECK(nothing["lower"] == 0.0);
}

TEST_CASE("blocks of points hold every point to half a step", "[apps][report]") {
    CHECK(spread_bits(0b1011) == 0b1000101U);
    CHECK(spread_bits(0xffff) == 0x55555555U);
    std::mt19937 random(7);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    std::vector<std::pair<double, double>> points;
    for (int i = 0; i < 70000; ++i)
        points.emplace_back(uniform(random), std::pow(uniform(random), 3.0));
    points.emplace_back(0.0, 1.0);
    points.emplace_back(1.0, 0.0);
    const PointBlocks blocks = point_blocks(points);
    CHECK(blocks.given == points.size());
    CHECK(blocks.kept == points.size());
    std::vector<std::pair<unsigned, unsigned>> found;
    for (const auto& block : blocks.blocks) {
        const auto bytes = bytes_of(block.base64);
        std::uint64_t key = 0;
        std::size_t at = 0;
        for (std::size_t k = 0; k < block.count; ++k) {
            std::uint64_t difference = 0;
            for (unsigned shift = 0;; shift += 7) {
                REQUIRE(at < bytes.size());
                difference |= static_cast<std::uint64_t>(bytes[at] & 127U) << shift;
                if (bytes[at++] < 128) break;
            }
            key += difference;
            unsigned x = 0;
            unsigned y = 0;
            for (unsigned bit = 0; bit < 16; ++bit) {
                x |= static_cast<unsigned>((key >> (2 * bit)) & 1U) << bit;
                y |= static_cast<unsigned>((key >> (2 * bit + 1)) & 1U) << bit;
            }
            found.emplace_back(x, y);
        }
        CHECK(at == bytes.size());
    }
    std::vector<std::pair<unsigned, unsigned>> expected;
    for (const auto& [x, y] : points)
        expected.emplace_back(std::lround(65535.0 * x), std::lround(65535.0 * y));
    std::sort(found.begin(), found.end());
    std::sort(expected.begin(), expected.end());
    CHECK(found == expected);

    const PointBlocks thin = point_blocks(points, 10000);
    CHECK(thin.kept == (points.size() + 7) / 8);
    CHECK(thin.kept <= 10000);
    CHECK(point_blocks({}).blocks.empty());
    CHECK_THROWS_WITH(point_blocks(points, 0), "point blocks: most is 0, must be > 0");
}

TEST_CASE("a chart's text cannot end its script element", "[apps][report]") {
    Chart chart{"name", "</script><!--", "", {}};
    ChartView view;
    view.label = "<b>";
    view.layers.push_back({LayerKind::points, "</script>", 1, Ink::of_style, {1.0}, {2.0}});
    chart.views.push_back(view);
    const std::string text = chart_text(chart);
    CHECK_FALSE(contains(text, "<"));
    CHECK(json::parse(text)["title"] == "</script><!--");
    CHECK(json::parse(text)["views"][0]["layers"][0]["name"] == "</script>");
}

TEST_CASE("axes hold their data with room, also where these are one value or none", "[apps][report]") {
    ChartRange range;
    CHECK(range.empty());
    CHECK(range.axis("x", "").upper > range.axis("x", "").lower);
    range.include(undefined);
    CHECK(range.empty());
    range.include(3.0);
    CHECK(range.axis("x", "").lower < 3.0);
    CHECK(range.axis("x", "").upper > 3.0);
    range.include(3e5);
    CHECK(range.axis("x", "", true).log);
    range.include(0.0);
    CHECK_FALSE(range.axis("x", "", true).log);
}

TEST_CASE("a run writes its report, the same bytes again from the folder", "[apps][report][run]") {
    const TemporaryFolder folder;
    json job = pendulum_job();
    job["title"] = "</script><b>short</b>";
    const Path out = folder.path() / "out";
    const Outcome run = orbid_with({"run", write_job(folder.path() / "job.json", job), "--out", out});
    CAPTURE(run.error);
    REQUIRE(run.code == 0);
    const std::string page = read_whole_file(out / "report.html");
    CHECK(page.starts_with("<!DOCTYPE html>"));
    for (const char* heading : {"In short", "Parameters", "Section and periodic orbits", "Fit and residuals",
                                "What the data determine", "Course of the estimate", "Where this comes from"})
        CHECK(contains(page, std::string(">") + heading + "</h2>"));
    // Nothing was sampled or profiled.
    CHECK_FALSE(contains(page, ">Posterior</h2>"));
    CHECK(contains(page, "<h1>&lt;/script&gt;&lt;b&gt;short&lt;/b&gt;</h1>"));
    CHECK_FALSE(contains(page, "<b>short"));
    CHECK(contains(page, "<figure id=\"plot-section\""));
    CHECK(contains(page, "k2_over_m"));
    CHECK_FALSE(contains(page, "http://localhost"));
    // Names of namespaces are the only addresses.
    CHECK(count_of(page, "https://") == 0);

    std::filesystem::remove(out / "report.html");
    const Outcome again = orbid_with({"report", out});
    CHECK(again.code == 0);
    CHECK(contains(again.out, "report.html"));
    CHECK(read_whole_file(out / "report.html") == page);

    // Of an older run, or a folder without it, the times are simply missing.
    std::filesystem::remove(out / "timing.json");
    REQUIRE(orbid_with({"report", out}).code == 0);
    CHECK_FALSE(contains(read_whole_file(out / "report.html"), "<caption>Times"));
    CHECK(contains(page, "<caption>Times"));

    // Without known values there is nothing that intervals should reach.
    CHECK(contains(page, "seen from the reference values"));
    json result = read_json(out / "result.json");
    for (const char* block : {"parameters", "derived"})
        for (auto& [name, entry] : result[block].items())
            entry.erase("reference");
    write_text(out / "result.json", result.dump());
    REQUIRE(orbid_with({"report", out}).code == 0);
    const std::string unknown = read_whole_file(out / "report.html");
    CHECK_FALSE(contains(unknown, "seen from the reference values"));
    CHECK(contains(unknown, "95 % intervals, in percent of the estimates"));
}

TEST_CASE("residuals that follow each other are told once, by the verdict where it says so", "[apps][report]") {
    const TemporaryFolder folder;
    write_stored_run(folder.path());
    json result = read_json(folder.path() / "result.json");
    result["errors"]["series.x"].update({{"count", 100}, {"effective_count", 20.0}, {"lag1", 0.9}});
    const std::string reason = "follow each other: 100 are worth 20";
    const bool judged = GENERATE(false, true);
    CAPTURE(judged);
    if (judged)
        result["verdict"] = {{"trust", "values"}, {"line", "trust the values: residuals of series.x " + reason}};
    write_text(folder.path() / "result.json", result.dump());
    REQUIRE(orbid_with({"report", folder.path()}).code == 0);
    const std::string html = read_whole_file(folder.path() / "report.html");
    CHECK(contains(html, reason) == judged);
    CHECK(contains(html, "Residuals of series.x follow each other: 100 records are worth about 20") == !judged);
}

TEST_CASE("a report is refused where there is no run, and says which file is broken", "[apps][report]") {
    const TemporaryFolder folder;
    const Outcome nowhere = orbid_with({"report", folder.path() / "nowhere"});
    CHECK(nowhere.code == 2);
    CHECK(contains(nowhere.error, "nowhere"));
    CHECK(orbid_with({"report", folder.path()}).code == 2);
    CHECK(orbid_with({"report"}).code == 2);

    write_job(folder.path() / "job.json", json{{"format", "orbid-job/1"}, {"model", {{"name", "henon"}}}});
    write_text(folder.path() / "result.json", "{ \"format\": \"orbid-result/1\",\n  broken");
    const Outcome broken = orbid_with({"report", folder.path()});
    CHECK(broken.code == 3);
    CHECK(contains(broken.error, "result.json"));
    CHECK_FALSE(std::filesystem::exists(folder.path() / "report.html"));
}

}  // namespace report_test

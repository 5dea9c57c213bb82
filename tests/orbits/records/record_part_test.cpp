// Parts of a record: rows, windows in time, every so many samples, times from a step.

#include <limits>

#include "orbits/records/record_part.hpp"
#include "orbits/records/series_file.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/records/scratch_folder.hpp"

namespace record_part_test {

using namespace orbid;
using namespace orbid::orbits;
using tests::ContainsSubstring;
using tests::ScratchFolder;

namespace {

/// Two segments, a of six rows and b of four, 0.1 s apart. The value of row r of the file is r.
std::string two_segments() {
    std::string text = "segment,t,x\n";
    for (int row = 1; row <= 10; ++row)
        text += (row <= 6 ? "a," : "b,") + std::to_string(0.1 * (row <= 6 ? row - 1 : row - 7)) + "," +
                std::to_string(row) + "\n";
    return text;
}

TableLayout layout_of(const RecordPart& part) {
    TableLayout layout;
    layout.sampling = Series::Sampling::samples;
    layout.coordinates = {{{"x", "m", false}, "x", "", 1.0, 0.0}};
    layout.segment = "segment";
    layout.time = "t";
    layout.part = part;
    return layout;
}

/// The values that are read, a list per segment, by both ways: while a table is read, and of a series in memory.
std::vector<std::vector<double>> values_in(const RecordPart& part) {
    const ScratchFolder folder;
    const auto file = folder.file("record.csv", two_segments());
    const Series read = read_csv(file, layout_of(part));
    const Series cut = part_of(read_csv(file, layout_of({})), part, "record");
    std::vector<std::vector<double>> values;
    REQUIRE(cut.segments.size() == read.segments.size());
    for (std::size_t s = 0; s < read.segments.size(); ++s) {
        const Segment& segment = read.segments[s];
        CHECK(cut.segments[s].label == segment.label);
        CHECK(cut.segments[s].values == segment.values);
        CHECK(cut.segments[s].times == segment.times);
        for (Eigen::Index k = 0; k < segment.times.size(); ++k) {
            const double row = segment.values(0, k);
            CHECK(segment.times[k] == std::stod(std::to_string(0.1 * (row <= 6 ? row - 1 : row - 7))));
        }
        values.emplace_back(segment.values.data(), segment.values.data() + segment.values.cols());
    }
    return values;
}

RecordPart rows(std::size_t first, std::size_t last, std::size_t every = 1) {
    RecordPart part;
    part.first_row = first;
    part.last_row = last;
    part.every = every;
    return part;
}

RecordPart window(double begin, double end, std::size_t every = 1) {
    RecordPart part;
    part.begin = begin;
    part.end = end;
    part.every = every;
    return part;
}

std::string refusal(const std::string& text, const TableLayout& layout) {
    const ScratchFolder folder;
    try {
        static_cast<void>(read_csv(folder.file("record.csv", text), layout));
    } catch (const DataError& error) {
        return error.what();
    }
    return "";
}

}  // namespace

TEST_CASE("rows, windows and every so many samples of a record are read", "[orbits][records]") {
    using Values = std::vector<std::vector<double>>;
    CHECK(values_in({}) == Values{{1, 2, 3, 4, 5, 6}, {7, 8, 9, 10}});
    CHECK(values_in(rows(3, 8)) == Values{{3, 4, 5, 6}, {7, 8}});
    CHECK(values_in(rows(8, 100)) == Values{{8, 9, 10}});
    CHECK(values_in(window(0.1, 0.3)) == Values{{2, 3, 4}, {8, 9, 10}});
    CHECK(values_in(window(0.35, 9.0)) == Values{{5, 6}});
    CHECK(values_in(rows(1, 10, 2)) == Values{{1, 3, 5}, {7, 9}});
    CHECK(values_in(rows(2, 10, 3)) == Values{{2, 5}, {7, 10}});
    CHECK(values_in(window(0.1, 9.0, 2)) == Values{{2, 4, 6}, {8, 10}});
}

TEST_CASE("what lies outside the part is not looked at", "[orbits][records]") {
    const std::string text = "t,x\n0,1\n1,broken\n5,3\n6,4\n7,5\n8,inf\n";
    TableLayout layout = layout_of(window(5.0, 7.0));
    layout.segment.clear();
    const ScratchFolder folder;
    const Series series = read_csv(folder.file("record.csv", text), layout);
    REQUIRE(series.segments.size() == 1);
    CHECK(series.segments[0].values == Eigen::RowVector3d(3, 4, 5));
    CHECK(series.segments[0].times == Eigen::Vector3d(5, 6, 7));
    // All of it has a gap and bad cells.
    layout.part = {};
    CHECK_THAT(refusal(text, layout), ContainsSubstring("record.csv:3, column \"x\""));
    layout.part = rows(3, 6);
    CHECK_THAT(refusal(text, layout), ContainsSubstring("record.csv:7, column \"x\""));
}

TEST_CASE("a step gives samples their times, counted from the first row of a segment", "[orbits][records]") {
    TableLayout layout = layout_of(rows(3, 9));
    layout.time.clear();
    layout.step = 0.25;
    const ScratchFolder folder;
    const Series series = read_csv(folder.file("record.csv", two_segments()), layout);
    REQUIRE(series.segments.size() == 2);
    CHECK(series.segments[0].times == Eigen::Vector4d(0.5, 0.75, 1.0, 1.25));
    CHECK(series.segments[1].times == Eigen::Vector3d(0.0, 0.25, 0.5));
    layout.part = window(0.5, 0.8);
    const Series cut = read_csv(folder.file("record.csv", two_segments()), layout);
    CHECK(cut.segments[0].values == Eigen::RowVector2d(3, 4));
    CHECK(cut.segments[1].values == Eigen::RowVector2d(9, 10));
}

TEST_CASE("a part without rows says what the record has", "[orbits][records]") {
    const std::string text = two_segments();
    CHECK_THAT(refusal(text, layout_of(rows(11, 20))), ContainsSubstring("has 10 rows, none from row 11 on"));
    CHECK_THAT(refusal(text, layout_of(window(2.0, 3.0))),
               ContainsSubstring("no row between 2 s and 3 s; its times reach from 0 s to 0.5 s"));
    CHECK_THROWS_WITH(part_of(Series{Series::Sampling::section, {}, {{"0", Readings(1, 2), {}, {}}}, 0.0, ""},
                              window(0.0, 1.0), "series.h5"),
                      ContainsSubstring("series.h5: has no times"));
}

TEST_CASE("a part that cannot be is a wrong call", "[orbits][records]") {
    const auto refused = [](const TableLayout& layout) {
        CHECK_THROWS_AS(read_csv("nowhere.csv", layout), std::invalid_argument);
    };
    refused(layout_of(rows(0, 3)));
    refused(layout_of(rows(4, 3)));
    refused(layout_of(rows(1, 3, 0)));
    refused(layout_of(window(1.0, 1.0)));
    refused(layout_of(window(std::numeric_limits<double>::quiet_NaN(), 1.0)));
    TableLayout sections = layout_of(rows(1, 3, 2));
    sections.sampling = Series::Sampling::section;
    refused(sections);
    sections.part = window(0.0, 1.0);
    sections.time.clear();
    refused(sections);
    TableLayout both = layout_of({});
    both.step = 0.1;
    refused(both);
    both.time.clear();
    both.step = -0.1;
    refused(both);
}

}  // namespace record_part_test

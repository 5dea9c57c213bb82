#include <bit>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <random>

#include "orbits/records/series_file.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/records/scratch_folder.hpp"
#include "tests/source_folder.hpp"

namespace csv_file_test {

using namespace orbid;
using namespace orbid::orbits;
using tests::ContainsSubstring;
using tests::ScratchFolder;
using tests::WithinAbs;

namespace {

TableLayout section_layout() {
    TableLayout layout;
    layout.coordinates = {{{"phi", "rad", true}, "theta", "", 1.0, 0.0}, {{"v", "rad/s", false}, "rate", "", 1.0, 0.0}};
    return layout;
}

TableLayout sampled_layout() {
    TableLayout layout = section_layout();
    layout.sampling = Series::Sampling::samples;
    layout.time = "t";
    layout.segment = "segment";
    return layout;
}

/// The message of the DataError that reading this text causes; empty when it causes none.
std::string refusal(const std::string& text, const TableLayout& layout) {
    const ScratchFolder folder;
    const auto file = folder.file("data.csv", text);
    try {
        static_cast<void>(read_csv(file, layout));
    } catch (const DataError& error) {
        const std::string message = error.what();
        const auto start = message.find("data.csv");
        REQUIRE(start != std::string::npos);
        return message.substr(start);
    }
    return "";
}

bool same_bits(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
    if (a.rows() != b.rows() || a.cols() != b.cols()) return false;
    for (Eigen::Index i = 0; i < a.size(); ++i) {
        if (std::bit_cast<std::uint64_t>(a.data()[i]) != std::bit_cast<std::uint64_t>(b.data()[i])) return false;
    }
    return true;
}

}  // namespace

TEST_CASE("columns are found by header and turned into model values", "[orbits]") {
    // value = sign * (column * factor * unit - offset): 90 deg with sign -1 and offset pi is pi/2.
    const ScratchFolder folder;
    const auto file = folder.file("a.csv", "rate,ignored,theta\n1,x,90\n-2.5e-3,y,180\n+3,z,0\n");
    TableLayout layout = section_layout();
    layout.coordinates[0].unit = "deg";
    layout.coordinates[0].sign = -1.0;
    layout.coordinates[0].offset = std::numbers::pi;
    layout.phase = 0.5;
    const Series series = read_csv(file, layout);
    REQUIRE(series.segments.size() == 1);
    CHECK(series.segments[0].label == "0");
    CHECK(series.phase == 0.5);
    CHECK(series.coordinates[0].angle);
    const orbits::Readings& values = series.segments[0].values;
    REQUIRE(values.cols() == 3);
    CHECK_THAT(values(0, 0), WithinAbs(std::numbers::pi / 2, 1e-15));
    CHECK_THAT(values(0, 1), WithinAbs(0.0, 1e-15));
    CHECK_THAT(values(0, 2), WithinAbs(std::numbers::pi, 1e-15));
    CHECK(values(1, 0) == 1.0);
    CHECK(values(1, 1) == -2.5e-3);
    CHECK(values(1, 2) == 3.0);

    // 45 half degrees per unit are read as 90 deg; the sd of a reading takes the factor too.
    const auto volts = folder.file("b.csv", "theta,rate,sd\n2,1,0.5\n");
    layout.coordinates[0].factor = 45.0;
    layout.coordinates[1].factor = 0.25;
    layout.coordinates[1].sd = "sd";
    const Series scaled = read_csv(volts, layout);
    CHECK_THAT(scaled.segments[0].values(0, 0), WithinAbs(std::numbers::pi / 2, 1e-15));
    CHECK(scaled.segments[0].values(1, 0) == 0.25);
    CHECK(scaled.segments[0].deviations(1, 0) == 0.125);
}

TEST_CASE("delimiters, comments, quotes, line ends and the byte order mark are understood", "[orbits]") {
    const auto layout = section_layout();
    const ScratchFolder folder;
    const std::vector<std::string> texts{
        "theta,rate\n1,2\n3,4\n",
        "theta;rate\n1;2\n3;4\n",
        "theta\trate\n1\t2\n3\t4\n",
        "\xEF\xBB\xBF# made by hand\n\ntheta,rate\r\n1,2\r\n# between\r\n\r\n3,4",
        "\"theta\", \"rate\" ,\"a \"\"b\"\", c\"\n \"1\" , 2 ,\"x\"\n3,4,\"\"\"\"\n",
    };
    for (const std::string& text : texts) {
        CAPTURE(text);
        const Series series = read_csv(folder.file("a.csv", text), layout);
        REQUIRE(series.segments.size() == 1);
        CHECK(series.segments[0].values == (Eigen::Matrix2d() << 1, 3, 2, 4).finished());
    }
}

TEST_CASE("an empty cell is a missing sample, and nan when it is declared to be one", "[orbits]") {
    const ScratchFolder folder;
    auto layout = section_layout();
    const Series series = read_csv(folder.file("a.csv", "theta,rate\n1,\n,2\n\"\",3\n"), layout);
    CHECK(std::isnan(series.segments[0].values(1, 0)));
    CHECK(std::isnan(series.segments[0].values(0, 1)));
    CHECK(std::isnan(series.segments[0].values(0, 2)));
    CHECK(series.segments[0].values(1, 1) == 2.0);

    layout.nan_is_missing = true;
    CHECK(std::isnan(read_csv(folder.file("a.csv", "theta,rate\nNaN,1\n"), layout).segments[0].values(0, 0)));
    CHECK_THAT(refusal("theta,rate\n1,inf\n", layout), ContainsSubstring("not a finite number"));
}

TEST_CASE("rows of equal label form segments, times belong to samples", "[orbits]") {
    const ScratchFolder folder;
    const auto file = folder.file("a.csv", "segment,t,theta,rate\nb,0,1,2\nb,100,3,4\nb,200,3,4\n7,0,5,6\n7,50,7,8\n");
    auto layout = sampled_layout();
    layout.time_unit = "ms";
    const Series series = read_csv(file, layout);
    REQUIRE(series.segments.size() == 2);
    CHECK(series.segments[0].label == "b");
    CHECK(series.segments[1].label == "7");
    CHECK(series.segments[0].values.cols() == 3);
    CHECK_THAT(series.segments[0].times[2], WithinAbs(0.2, 1e-16));
    CHECK(series.segments[1].values(1, 1) == 8.0);
    CHECK_THAT(series.segments[1].times[1], WithinAbs(0.05, 1e-16));
}

TEST_CASE("what cannot be read is refused with file, line, column and rule", "[orbits]") {
    const auto layout = section_layout();
    const auto sampled = sampled_layout();
    CHECK(refusal("theta,rate\n1,2\n", layout).empty());
    CHECK(refusal("theta,rate\n1,2\n3,4a\n", layout) ==
          "data.csv:3, column \"rate\": \"4a\" is not a number; a missing sample is an empty cell");
    CHECK_THAT(refusal("# c\ntheta,rate\n\nNA,2\n", layout), ContainsSubstring("data.csv:4, column \"theta\": \"NA\""));
    CHECK_THAT(refusal("theta,rate\n1,1e999\n", layout), ContainsSubstring("outside the range of a double"));
    CHECK_THAT(refusal("theta;rate\n1,5;2\n", layout), ContainsSubstring("decimal point"));
    CHECK(refusal("theta,rate\n1,2\n1,2,3\n", layout) == "data.csv:3: has 3 cells, the header has 2 columns");
    CHECK_THAT(refusal("theta,rate\n1,5,2,5\n", layout), ContainsSubstring("decimal commas?"));
    CHECK(refusal("theta,rate\n1\n", layout) ==
          "data.csv:2: has 1 cell, the header has 2 columns; the cell of a missing sample is there, and empty");
    CHECK(refusal("theta,rat,t\n1,2,3\n", layout) ==
          "data.csv: no column \"rate\" (did you mean \"rat\"?); the columns are \"theta\", \"rat\", \"t\"");
    CHECK_THAT(refusal("theta,rate,theta\n1,2,3\n", layout), ContainsSubstring("column \"theta\" appears twice"));
    CHECK_THAT(refusal("theta,rate\n1,nan\n", layout),
               ContainsSubstring("data.csv:2, column \"rate\": \"nan\" is not"));
    CHECK_THAT(refusal("theta,rate\n-inf,1\n", layout),
               ContainsSubstring("data.csv:2, column \"theta\": \"-inf\" is not"));
    CHECK_THAT(refusal("", layout), ContainsSubstring("data.csv: is empty"));
    CHECK_THAT(refusal("\n# only a comment\n", layout), ContainsSubstring("data.csv: is empty"));
    CHECK_THAT(refusal("theta,rate\n", layout), ContainsSubstring("data.csv: has a header but no rows"));
    CHECK_THAT(refusal("theta,rate\n\"1,2\n", layout), ContainsSubstring("data.csv:2: a quote is opened"));
    CHECK_THAT(refusal("theta,rate\n\"1\"2,2\n", layout),
               ContainsSubstring("data.csv:2: text follows a closing quote"));
    CHECK_THAT(refusal(std::string("\x89HDF\r\n\x1a\n\0\0", 10), layout), ContainsSubstring("not a text file"));

    auto longer = layout;
    longer.minimum_points = 3;
    CHECK(refusal("theta,rate\n1,2\n1,2\n", longer) == "data.csv: has 2 points, at least 3 are needed");

    CHECK_THAT(refusal("segment,t,theta,rate\n0,0,1,2\n1,0,1,2\n0,1,1,2\n", sampled),
               ContainsSubstring("data.csv:4, column \"segment\": segment \"0\" comes back"));
    CHECK_THAT(refusal("segment,t,theta,rate\n,0,1,2\n", sampled),
               ContainsSubstring("data.csv:2, column \"segment\": is empty"));
    CHECK_THAT(refusal("segment,t,theta,rate\n0,0,1,2\n0,1,1,2\n0,1,1,2\n", sampled),
               ContainsSubstring("data.csv:4, column \"t\": time 1 s follows 1 s; times must ascend"));
    CHECK_THAT(refusal("segment,t,theta,rate\n0,0,1,2\n0,1,1,2\n0,3,1,2\n0,4,1,2\n", sampled),
               ContainsSubstring("data.csv:4, column \"t\": time step 2 s where the segment has 1 s (tolerance 5 %)"));
    CHECK_THAT(refusal("segment,t,theta,rate\n0,nan,1,2\n", sampled),
               ContainsSubstring("data.csv:2, column \"t\": a time must be a finite number"));
    CHECK_THAT(refusal("segment,t,theta,rate\n0,,1,2\n", sampled), ContainsSubstring("data.csv:2, column \"t\""));
}

TEST_CASE("a missing file and a folder are refused by name", "[orbits]") {
    const ScratchFolder folder;
    const auto layout = section_layout();
    CHECK_THROWS_WITH(read_csv(folder.path("none.csv"), layout), ContainsSubstring("none.csv: no such file"));
    CHECK_THROWS_WITH(read_csv(folder.path(""), layout), ContainsSubstring("is a folder"));
    CHECK_THROWS_AS(read_csv(folder.path("none.csv"), layout), DataError);
}

TEST_CASE("a layout that cannot be meant is a wrong call", "[orbits]") {
    const ScratchFolder folder;
    const auto file = folder.file("a.csv", "theta,rate\n1,2\n");
    const auto refused = [&](auto change, const std::string& rule) {
        TableLayout layout = section_layout();
        change(layout);
        CAPTURE(rule);
        CHECK_THROWS_AS(read_csv(file, layout), std::invalid_argument);
        CHECK_THROWS_WITH(read_csv(file, layout), ContainsSubstring(rule));
    };
    refused([](TableLayout& l) { l.coordinates.clear(); }, "at least one coordinate");
    refused([](TableLayout& l) { l.coordinates[1].coordinate.name = "phi"; }, "mapped twice");
    refused([](TableLayout& l) { l.coordinates[0].sign = 2.0; }, "must be 1 or -1");
    refused([](TableLayout& l) { l.coordinates[0].factor = 0.0; }, "factor is 0, must be > 0");
    refused([](TableLayout& l) { l.coordinates[0].offset = std::nan(""); }, "offset must be a finite number");
    refused([](TableLayout& l) { l.coordinates[0].unit = "degrees"; },
            "\"degrees\" cannot be turned into rad; known: rad");
    refused([](TableLayout& l) { l.sampling = Series::Sampling::samples; }, "samples need a column of times");
    refused([](TableLayout& l) { l.time_tolerance = 1.0; }, "must lie in (0, 1)");
}

TEST_CASE("writing and reading back gives the same bits", "[orbits]") {
    // Doubles of every size, signs of zero, the smallest and largest, and missing samples.
    std::mt19937_64 bits(7);
    Series series;
    series.sampling = Series::Sampling::samples;
    series.phase = 0.1 + 0.2;
    series.coordinates = {{"phi", "rad", true}, {"odd, \"name\"", "m", false}};
    for (int s = 0; s < 3; ++s) {
        Segment segment;
        segment.label = s == 1 ? "run #1, \"b\"" : std::to_string(s);
        segment.values.resize(2, 500);
        segment.times = Eigen::VectorXd::LinSpaced(500, 0.1, 0.1 + 499.0 / 3.0);
        for (Eigen::Index i = 0; i < segment.values.size(); ++i) {
            double value = std::bit_cast<double>(bits());
            if (!std::isfinite(value)) value = std::numeric_limits<double>::quiet_NaN();
            segment.values.data()[i] = value;
        }
        segment.values(0, 0) = -0.0;
        segment.values(1, 0) = std::numeric_limits<double>::quiet_NaN();
        segment.values(0, 1) = std::numeric_limits<double>::denorm_min();
        segment.values(1, 1) = std::numeric_limits<double>::max();
        series.segments.push_back(segment);
    }
    const ScratchFolder folder;
    write_csv(folder.path("a.csv"), series);
    const Series back = read_csv(folder.path("a.csv"), table_layout(series));
    REQUIRE(back.segments.size() == 3);
    CHECK(back.phase == series.phase);
    CHECK(back.coordinates[1].name == series.coordinates[1].name);
    for (std::size_t s = 0; s < 3; ++s) {
        CHECK(back.segments[s].label == series.segments[s].label);
        CHECK(same_bits(back.segments[s].values, series.segments[s].values));
        CHECK(same_bits(back.segments[s].times, series.segments[s].times));
    }
}

TEST_CASE("what cannot be written is refused", "[orbits]") {
    const ScratchFolder folder;
    Series series;
    series.coordinates = {{"x", "m", false}};
    series.segments = {{"0", Eigen::MatrixXd::Ones(1, 2), {}}};
    CHECK_THROWS_WITH(write_csv(folder.path("no/such/folder.csv"), series), ContainsSubstring("cannot be opened"));
    series.segments[0].values(0, 1) = std::numeric_limits<double>::infinity();
    CHECK_THROWS_WITH(write_csv(folder.path("a.csv"), series), ContainsSubstring("point 1: an infinite value"));
    series.segments[0].values(0, 1) = 1.0;
    series.segments[0].label = "a\nb";
    CHECK_THROWS_WITH(write_csv(folder.path("a.csv"), series), ContainsSubstring("line break"));
    series.coordinates[0].name = "segment";
    CHECK_THROWS_WITH(write_csv(folder.path("a.csv"), series), ContainsSubstring("the name is taken"));
}

TEST_CASE("the recorded swing is read as its description says", "[orbits]") {
    TableLayout layout;
    layout.sampling = Series::Sampling::samples;
    layout.segment = "segment";
    layout.time = "t";
    layout.coordinates = {{{"phi", "rad", true}, "theta", "rad", 1.0, std::numbers::pi},
                          {{"phi_dot", "rad/s", false}, "theta_dot", "", 1.0, 0.0}};
    const Series series = read_csv(orbid::tests::source_folder() + "/configs/data/pendulum_swing/swing.csv", layout);
    REQUIRE(series.segments.size() == 4);
    CHECK(series.size() == 36668);
    for (const Segment& segment : series.segments) {
        CHECK(segment.values.cols() == 9167);
        CHECK(segment.times[0] == 0.0);
        CHECK(segment.times[9166] == 9.166);
        CHECK(segment.values.allFinite());
    }
    // First row of the file: 0,0.000,1.52316373,1.84825406.
    CHECK(series.segments[0].values(0, 0) == 1.52316373 - std::numbers::pi);
    CHECK(series.segments[0].values(1, 0) == 1.84825406);
}

TEST_CASE("the origin of a series stands in its file", "[orbits]") {
    const ScratchFolder folder;
    Series series;
    series.coordinates = {{"x", "m", false}};
    series.segments = {{"0", Eigen::MatrixXd::Ones(1, 2), {}}};
    write_csv(folder.path("a.csv"), series);
    CHECK(read_origin(folder.path("a.csv")).empty());
    series.origin = "pendulum, seed 1";
    write_csv(folder.path("a.csv"), series);
    CHECK(read_origin(folder.path("a.csv")) == series.origin);
    CHECK(read_csv(folder.path("a.csv"), table_layout(series)).size() == 2);
    write_hdf5(folder.path("a.h5"), series);
    CHECK(read_origin(folder.path("a.h5")) == series.origin);
    CHECK(read_hdf5(folder.path("a.h5")).origin == series.origin);
    series.origin = "two\nlines";
    CHECK_THROWS_AS(write_csv(folder.path("a.csv"), series), std::invalid_argument);
}

}  // namespace csv_file_test

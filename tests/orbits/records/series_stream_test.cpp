// Records that are read piece by piece: the same points as when they are read whole, cut anywhere.

#include "orbits/records/series_stream.hpp"

#include <bit>
#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "orbits/records/series_file.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/records/scratch_folder.hpp"

namespace series_stream_test {

using namespace orbid;
using namespace orbid::orbits;
using tests::ContainsSubstring;
using tests::ScratchFolder;

namespace {

template <class A, class B>
bool same_bits(const A& a, const B& b) {
    if (a.rows() != b.rows() || a.cols() != b.cols()) return false;
    for (Eigen::Index k = 0; k < a.cols(); ++k)
        for (Eigen::Index i = 0; i < a.rows(); ++i)
            if (std::bit_cast<std::uint64_t>(a(i, k)) != std::bit_cast<std::uint64_t>(b(i, k))) return false;
    return true;
}

/// Random readings, some of them missing.
Series example(const std::vector<Eigen::Index>& lengths, Series::Sampling sampling) {
    std::mt19937_64 random(11);
    std::normal_distribution<double> normal;
    Series series;
    series.sampling = sampling;
    series.phase = -0.1;
    series.coordinates = {{"phi", "rad", true}, {"phi_dot", "rad/s", false}};
    for (std::size_t s = 0; s < lengths.size(); ++s) {
        Segment segment;
        segment.label = "run " + std::to_string(s);
        segment.values.resize(2, lengths[s]);
        for (Eigen::Index i = 0; i < segment.values.size(); ++i)
            segment.values.data()[i] = i % 57 == 20 ? std::nan("") : normal(random);
        if (sampling == Series::Sampling::samples)
            segment.times = Eigen::VectorXd::LinSpaced(lengths[s], 0.0, 0.1 * static_cast<double>(lengths[s] - 1));
        series.segments.push_back(std::move(segment));
    }
    return series;
}

/// The part [first, first + count) of all points of `whole`, as `stream` gives it.
void check_part(const SeriesStream& stream, const Series& whole, std::size_t first, std::size_t count) {
    CAPTURE(first, count);
    std::size_t begin = 0, k = 0;
    const auto parts = stream.read(first, count);
    for (const Segment& segment : whole.segments) {
        const auto length = static_cast<std::size_t>(segment.values.cols());
        const std::size_t from = std::max(first, begin), to = std::min(first + count, begin + length);
        if (from < to) {
            REQUIRE(k < parts.size());
            const auto at = static_cast<Eigen::Index>(from - begin), some = static_cast<Eigen::Index>(to - from);
            CHECK(parts[k].label == segment.label);
            CHECK(same_bits(parts[k].values, segment.values.middleCols(at, some)));
            if (segment.times.size() > 0) CHECK(same_bits(parts[k].times, segment.times.segment(at, some)));
            ++k;
        }
        begin += length;
    }
    CHECK(k == parts.size());
}

/// What opening this text as a stream is refused with, from the name of the file on.
std::string refusal(const std::string& text, const TableLayout& layout) {
    const ScratchFolder folder;
    const auto file = folder.file("data.csv", text);
    try {
        (void)stream_csv(file, layout);
    } catch (const std::exception& error) {
        const std::string message = error.what();
        return message.substr(std::min(message.find("data.csv"), message.size()));
    }
    return "";
}

}  // namespace

TEST_CASE("a stream of a table gives any part of it, over the ends of its pieces", "[orbits][stream]") {
    const ScratchFolder folder;
    // 250 000 rows of 40 letters or so: more than two pieces of 4 MB, and a segment that spans two of them.
    const Series series = example({3, 180000, 70000}, Series::Sampling::section);
    write_csv(folder.path("a.csv"), series);
    const auto stream = stream_csv(folder.path("a.csv"), table_layout(series));
    CHECK(stream->lengths() == std::vector<std::size_t>{3, 180000, 70000});
    CHECK(stream->size() == 250003);
    CHECK_FALSE(stream->timed());
    CHECK(stream->header().segments.empty());
    CHECK(stream->header().coordinates.size() == 2);
    CHECK(stream->header().phase == table_layout(series).phase);
    check_part(*stream, series, 0, 250003);
    check_part(*stream, series, 0, 2);
    check_part(*stream, series, 1, 5);
    for (std::size_t first = 0; first < 250003; first += 9973)
        check_part(*stream, series, first, 10001);
    CHECK(stream->read(250003, 5).empty());
    CHECK(stream->read(300000, 5).empty());
}

TEST_CASE("a streamed table may have whatever a table may have", "[orbits][stream]") {
    const ScratchFolder folder;
    TableLayout layout;
    layout.coordinates = {{{"x", "", false}, "a", "", 1.0, 0.0}};
    layout.segment = "run";
    const auto file =
        folder.file("a.csv", "\xEF\xBB\xBF# comment\r\n\r\n\"run\";a;b\r\nu;1;9\r\n# between\r\nu;;9\r\n\r\nv;3;9");
    const auto stream = stream_csv(file, layout);
    CHECK(stream->lengths() == std::vector<std::size_t>{2, 1});
    check_part(*stream, read_csv(file, layout), 0, 3);
    check_part(*stream, read_csv(file, layout), 1, 2);
    // Lines are counted as in the file.
    CHECK_THAT(refusal("# first\n\na\n1\n2\nx\n",
                       [] {
                           TableLayout one;
                           one.coordinates = {{{"x", "", false}, "a", "", 1.0, 0.0}};
                           return one;
                       }()),
               ContainsSubstring("data.csv:6, column \"a\": \"x\" is not a number"));
}

TEST_CASE("what cannot be streamed is refused", "[orbits][stream]") {
    TableLayout layout;
    layout.coordinates = {{{"x", "", false}, "a", "", 1.0, 0.0}};
    CHECK_THAT(refusal("", layout), ContainsSubstring("is empty"));
    CHECK_THAT(refusal("a\n", layout), ContainsSubstring("has 0 points, at least 1 are needed"));
    CHECK_THAT(refusal("b\n1\n", layout), ContainsSubstring("no column \"a\""));
    TableLayout other = layout;
    other.minimum_points = 3;
    CHECK_THAT(refusal("a\n1\n2\n", other), ContainsSubstring("has 2 points, at least 3 are needed"));
    other = layout;
    other.segment = "s";
    CHECK_THAT(refusal("s,a\n1,1\n2,1\n1,1\n", other), ContainsSubstring("segment \"1\" comes back"));
    other = layout;
    other.part.first_row = 2;
    CHECK_THAT(refusal("a\n1\n2\n", other), ContainsSubstring("a part of it is asked for"));
    other = layout;
    other.sampling = Series::Sampling::samples;
    other.step = 0.1;
    CHECK_THAT(refusal("a\n1\n2\n", other), ContainsSubstring("holds samples, must hold sections"));
    other = layout;
    other.coordinates[0].sd = "b";
    CHECK_THAT(refusal("a,b\n1,1\n", other), ContainsSubstring("sds of readings are not read from streams"));
    CHECK_THROWS_AS(stream_csv("missing.csv", layout), DataError);
    CHECK_THROWS_WITH(stream_csv("a.mat", layout), ContainsSubstring("a file of Matlab cannot be streamed"));
    CHECK_THROWS_AS(stream_hdf5("missing.h5"), DataError);
}

TEST_CASE("a stream of an HDF5 file gives any part of it, cut where segments end", "[orbits][stream]") {
    const ScratchFolder folder;
    for (const auto sampling : {Series::Sampling::section, Series::Sampling::samples}) {
        const Series series = example({1, 200, 400}, sampling);
        write_hdf5(folder.path("a.h5"), series);
        const auto stream = stream_hdf5(folder.path("a.h5"));
        CHECK(stream->lengths() == std::vector<std::size_t>{1, 200, 400});
        CHECK(stream->timed() == (sampling == Series::Sampling::samples));
        CHECK(stream->header().coordinates.size() == 2);
        CHECK(stream->header().segments.empty());
        CHECK(stream->header().sampling == sampling);
        check_part(*stream, series, 0, 10000);
        check_part(*stream, series, 150, 100);
        check_part(*stream, series, 301, 7);
        CHECK(stream->read(601, 5).empty());
        CHECK(stream->read(700, 5).empty());
    }
}

TEST_CASE("several files are one stream after the other", "[orbits][stream]") {
    const ScratchFolder folder;
    Series whole = example({300, 200, 100}, Series::Sampling::section);
    std::vector<std::unique_ptr<SeriesStream>> records;
    for (std::size_t i = 0; i < 3; ++i) {
        Series one = whole;
        one.segments = {whole.segments[i]};
        const auto file = folder.path("part" + std::to_string(i) + ".h5");
        write_hdf5(file, one);
        records.push_back(stream_hdf5(file));
    }
    const auto stream = joined(std::move(records));
    CHECK(stream->lengths() == std::vector<std::size_t>{300, 200, 100});
    for (std::size_t first = 0; first < 600; first += 37)
        check_part(*stream, whole, first, 250);
    check_part(*stream, whole, 0, 600);

    Series other = whole;
    other.coordinates[1].name = "v";
    write_hdf5(folder.path("other.h5"), other);
    std::vector<std::unique_ptr<SeriesStream>> unlike;
    unlike.push_back(stream_hdf5(folder.path("part0.h5")));
    unlike.push_back(stream_hdf5(folder.path("other.h5")));
    CHECK_THROWS_WITH(joined(std::move(unlike)), ContainsSubstring("record 2 has other coordinates"));
}

}  // namespace series_stream_test

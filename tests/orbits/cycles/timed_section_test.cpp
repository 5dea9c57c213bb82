// Sections whose crossings have times, and columns that must be complete, in files.

#include <limits>

#include "orbits/records/series_file.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/records/scratch_folder.hpp"

namespace timed_section_test {

using namespace orbid;
using namespace orbid::orbits;
using tests::ContainsSubstring;

namespace {

Series crossings() {
    Series series;
    series.sampling = Series::Sampling::section;
    series.coordinates = {{"x", "1", false}, {"z", "1", false}};
    Eigen::MatrixXd values(2, 3);
    values << 0.1, -0.25, 1.0 / 3.0, 27.0, 27.0, 27.0;
    series.segments.push_back({"0", values, Eigen::Vector3d(0.5, 1.25, 2.0 + 1.0 / 7.0), {}});
    series.segments.push_back({"1", values.leftCols(1), Eigen::VectorXd::Constant(1, 0.75), {}});
    return series;
}

void check_equal(const Series& read, const Series& written) {
    CHECK(read.timed());
    CHECK(read.sampling == written.sampling);
    REQUIRE(read.segments.size() == written.segments.size());
    for (std::size_t s = 0; s < read.segments.size(); ++s) {
        CHECK(read.segments[s].values == written.segments[s].values);
        CHECK(read.segments[s].times == written.segments[s].times);
    }
}

}  // namespace

TEST_CASE("times of crossings come back from both kinds of file", "[orbits]") {
    const tests::ScratchFolder folder;
    const Series series = crossings();
    CHECK(table_layout(series).time == "t");
    write_csv(folder.path("a.csv"), series);
    check_equal(read_csv(folder.path("a.csv"), table_layout(series)), series);
    write_hdf5(folder.path("a.h5"), series);
    check_equal(read_hdf5(folder.path("a.h5")), series);
    // A section at a phase has none.
    Series plain = series;
    for (Segment& segment : plain.segments)
        segment.times.resize(0);
    CHECK_FALSE(plain.timed());
    CHECK(table_layout(plain).time.empty());
    write_hdf5(folder.path("b.h5"), plain);
    CHECK_FALSE(read_hdf5(folder.path("b.h5")).timed());
}

TEST_CASE("times of crossings ascend, and all points have one or none", "[orbits]") {
    const tests::ScratchFolder folder;
    TableLayout layout = table_layout(crossings());
    (void)folder.file("back.csv", "segment,t,x,z\n0,1,0,27\n0,0.5,0,27\n");
    CHECK_THROWS_WITH(read_csv(folder.path("back.csv"), layout),
                      ContainsSubstring("back.csv:3, column \"t\": time 0.5 s follows 1 s"));
    Series some = crossings();
    some.segments[1].times.resize(0);
    CHECK_FALSE(some.timed());
    CHECK_THROWS_WITH(
        write_hdf5(folder.path("some.h5"), some),
        ContainsSubstring("segment \"0\" has 3 times and 3 points; all crossings of a section have times"));
}

TEST_CASE("columns that must be complete name the line of a gap, times need not be equidistant", "[orbits]") {
    const tests::ScratchFolder folder;
    TableLayout layout;
    layout.sampling = Series::Sampling::samples;
    layout.coordinates = {{{"u", "m", false}, "u", "mm", -1.0, 0.0, {}}};
    layout.time = "t";
    layout.complete = true;
    layout.nan_is_missing = true;
    (void)folder.file("uneven.csv", "t,u\n0,1000\n0.1,2000\n0.5,3000\n");
    CHECK_THROWS_WITH(read_csv(folder.path("uneven.csv"), layout), ContainsSubstring("samples must be equidistant"));
    layout.equidistant = false;
    const Series read = read_csv(folder.path("uneven.csv"), layout);
    CHECK(read.segments[0].times == Eigen::Vector3d(0.0, 0.1, 0.5));
    CHECK(read.segments[0].values == Eigen::RowVector3d(-1.0, -2.0, -3.0));
    (void)folder.file("gap.csv", "t,u\n0,1\n0.1,\n");
    CHECK_THROWS_WITH(read_csv(folder.path("gap.csv"), layout),
                      ContainsSubstring("gap.csv:3, column \"u\": is empty; this column must be complete"));
    (void)folder.file("nan.csv", "t,u\n0,1\n0.1,nan\n");
    CHECK_THROWS_WITH(
        read_csv(folder.path("nan.csv"), layout),
        ContainsSubstring("nan.csv:3, column \"u\": \"nan\" is not a finite number; this column must be"));
}

}  // namespace timed_section_test

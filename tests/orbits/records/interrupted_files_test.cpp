// Reading and writing long records is left within a block of some megabytes.

#include <functional>

#include "models/system/stopped.hpp"
#include "orbits/records/series_file.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/records/scratch_folder.hpp"

namespace interrupted_files_test {

using namespace orbid;
using namespace orbid::orbits;
using tests::ScratchFolder;

namespace {

/// Two coordinates, six million points: several blocks of both formats.
Series long_series() {
    Series series;
    series.coordinates = {{"x", "1", false}, {"y", "1", false}};
    Segment segment;
    segment.label = "0";
    segment.values = Eigen::MatrixXd::Constant(2, 6'000'000, 1.0);
    segment.values(1, 5'999'999) = 2.0;
    series.segments.push_back(std::move(segment));
    return series;
}

/// Says stop when it is asked for the given time.
std::function<bool()> stop_at(int question, int& asked) {
    asked = 0;
    return [question, &asked] { return ++asked == question; };
}

}  // namespace

TEST_CASE("files of long records are read and written in blocks that ask", "[orbits][records]") {
    const Series series = long_series();
    const ScratchFolder folder;
    int asked = 0;
    CHECK_THROWS_AS(write_hdf5(folder.path("a.h5"), series, stop_at(3, asked)), models::Stopped);
    CHECK_THROWS_AS(write_csv(folder.path("a.csv"), series, stop_at(3, asked)), models::Stopped);
    // The same bytes whether somebody may ask or not.
    write_hdf5(folder.path("b.h5"), series, stop_at(1000, asked));
    CHECK(asked >= 5);
    write_hdf5(folder.path("c.h5"), series);
    CHECK(ScratchFolder::bytes(folder.path("b.h5")) == ScratchFolder::bytes(folder.path("c.h5")));
    write_csv(folder.path("b.csv"), series, stop_at(1000, asked));
    CHECK(asked >= 20);

    CHECK_THROWS_AS(read_hdf5(folder.path("b.h5"), 1, stop_at(4, asked)), models::Stopped);
    const Series back = read_hdf5(folder.path("b.h5"), 1, stop_at(1000, asked));
    CHECK(asked >= 5);
    CHECK(back.segments[0].values == series.segments[0].values);
    TableLayout layout = table_layout(series);
    layout.interrupted = stop_at(4, asked);
    CHECK_THROWS_AS(read_csv(folder.path("b.csv"), layout), models::Stopped);
}

}  // namespace interrupted_files_test

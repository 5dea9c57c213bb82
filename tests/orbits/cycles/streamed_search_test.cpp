// Cycles of records that are read piece by piece.

#include "orbits/cycles/streamed_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>

#include "orbits/cycles/near_places.hpp"
#include "orbits/records/series_file.hpp"
#include "orbits/records/series_stream.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/records/scratch_folder.hpp"
#include "tests/orbits/sections/map_series.hpp"

namespace streamed_search_test {

using namespace orbid;
using orbits::Cycle;
using orbits::CycleSearch;
using orbits::CycleSearchOptions;
using tests::ContainsSubstring;

namespace {

constexpr std::size_t per_point = 4 * 2 * sizeof(double);  // what find_cycles asks of memory for two coordinates

// Two segments, so that blocks and stretches meet an end.
orbits::Series cut(const orbits::Series& whole, Eigen::Index at) {
    const orbits::Readings& values = whole.segments[0].values;
    return tests::section_series(whole.coordinates, {values.leftCols(at), values.rightCols(values.cols() - at)});
}

// The largest difference of coordinates to the nearest shift of a cycle of the same period, angles on the circle.
double nearest(const Cycle& cycle, const std::vector<Cycle>& others, bool angles) {
    double best = 1e300;
    for (const Cycle& other : others) {
        if (other.period != cycle.period) continue;
        for (Eigen::Index shift = 0; shift < cycle.period; ++shift) {
            double largest = 0.0;
            for (Eigen::Index j = 0; j < cycle.period; ++j)
                for (Eigen::Index d = 0; d < cycle.points.rows(); ++d) {
                    const double r = cycle.points(d, j) - other.points(d, (j + shift) % cycle.period);
                    largest = std::max(largest, std::abs(angles ? std::remainder(r, 2.0 * std::numbers::pi) : r));
                }
            best = std::min(best, largest);
        }
    }
    return best;
}

}  // namespace

TEST_CASE("a record that fits into memory is searched as a series is", "[orbits][cycles][stream]") {
    const tests::ScratchFolder folder;
    const auto series = cut(tests::henon_series(20000), 7000);
    write_hdf5(folder.path("a.h5"), series);
    CycleSearchOptions options;
    options.periods = {1, 2, 4, 6};
    const CycleSearch expected = find_cycles(series, options);
    const CycleSearch found = find_cycles(*orbits::stream_hdf5(folder.path("a.h5")), options, 20000 * per_point);
    REQUIRE(!expected.cycles.empty());
    REQUIRE(found.cycles.size() == expected.cycles.size());
    CHECK(found.candidates == expected.candidates);
    CHECK(found.remarks == expected.remarks);
    for (std::size_t i = 0; i < found.cycles.size(); ++i) {
        CHECK(found.cycles[i].points == expected.cycles[i].points);
        CHECK(found.cycles[i].covariance == expected.cycles[i].covariance);
        CHECK(found.cycles[i].multipliers == expected.cycles[i].multipliers);
    }
}

TEST_CASE("cycles of a record beyond memory are refined on all of it", "[orbits][cycles][stream]") {
    // The standard map is no polynomial: fits in denser points are better. An eighth of the points fits.
    const tests::ScratchFolder folder;
    const auto series = cut(tests::standard_map_series(1 << 17), 50000);
    write_hdf5(folder.path("a.h5"), series);
    const auto record = orbits::stream_hdf5(folder.path("a.h5"));
    CycleSearchOptions options;
    options.periods = {1, 2};
    options.symmetry_signs = std::vector<double>{-1.0, -1.0};
    const CycleSearch whole = find_cycles(series, options);
    const CycleSearch found = find_cycles(*record, options, (std::size_t{1} << 14) * per_point);
    REQUIRE(found.remarks.size() == 2);
    CHECK_THAT(found.remarks[0], ContainsSubstring("Of 131072 points 16384 fit"));
    REQUIRE(found.cycles.size() >= 4);
    std::size_t refined = 0;
    for (std::size_t i = 0; i < found.cycles.size(); ++i) {
        const Cycle& cycle = found.cycles[i];
        REQUIRE(cycle.mirror.has_value());
        REQUIRE(*cycle.mirror < found.cycles.size());
        CHECK(found.cycles[*cycle.mirror].mirror == i);
        if (!cycle.quality.empty()) continue;
        ++refined;
        // All neighbours of the whole series are there: the same fits, but for the order of their sums.
        CAPTURE(cycle.period, i);
        CHECK(nearest(cycle, whole.cycles, true) < 1e-9);
    }
    CHECK(2 * refined >= found.cycles.size());
}

TEST_CASE("memory for too few points is refused", "[orbits][stream]") {
    const tests::ScratchFolder folder;
    write_hdf5(folder.path("a.h5"), tests::henon_series(20000));
    const auto record = orbits::stream_hdf5(folder.path("a.h5"));
    CHECK_THROWS_WITH(find_cycles(*record, CycleSearchOptions{}, 10000 * per_point),
                      ContainsSubstring("at least 16384 are needed"));
}

TEST_CASE("near places are those within the radius, across seams", "[orbits][stream]") {
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> uniform(-0.5, 0.5);
    for (const Eigen::Index n : {1, 2, 3, 4}) {
        CAPTURE(n);
        Eigen::MatrixXd places(n, 30);
        std::vector<double> radii;
        std::vector<char> angle;
        for (Eigen::Index d = 0; d < n; ++d)
            angle.push_back(d % 2 == 0 ? 1 : 0);
        for (Eigen::Index i = 0; i < places.cols(); ++i) {
            for (Eigen::Index d = 0; d < n; ++d)
                places(d, i) = uniform(random);
            radii.push_back(i == 0 ? 0.45 : 0.05 + 0.4 * std::abs(uniform(random)));
        }
        for (const bool wide : {true, false}) {
            // Without the first, cells are small.
            const Eigen::Index first = wide ? 0 : 1;
            const orbits::NearPlaces near(places.rightCols(30 - first), {radii.begin() + first, radii.end()}, angle);
            int inside = 0;
            for (int trial = 0; trial < 3000; ++trial) {
                Eigen::VectorXd state(n);
                for (Eigen::Index d = 0; d < n; ++d)
                    state[d] = (angle[static_cast<std::size_t>(d)] ? 4.0 : 1.3) * uniform(random);
                bool expected = false;
                for (Eigen::Index i = first; i < places.cols(); ++i) {
                    double distance2 = 0.0;
                    for (Eigen::Index d = 0; d < n; ++d) {
                        const double r = state[d] - places(d, i);
                        const double on_circle = angle[static_cast<std::size_t>(d)] ? std::remainder(r, 1.0) : r;
                        distance2 += on_circle * on_circle;
                    }
                    expected = expected ||
                               distance2 <= radii[static_cast<std::size_t>(i)] * radii[static_cast<std::size_t>(i)];
                }
                inside += expected ? 1 : 0;
                REQUIRE(near.contains(state.data()) == expected);
            }
            CHECK(inside > 10);
        }
    }
    const std::array<double, 2> missing{std::nan(""), 0.0};
    CHECK_FALSE(orbits::NearPlaces(Eigen::MatrixXd::Zero(2, 1), {10.0}, {0, 0}).contains(missing.data()));
}

}  // namespace streamed_search_test

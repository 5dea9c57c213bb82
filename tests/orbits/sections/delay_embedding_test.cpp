// Delay vectors of motions whose delay and dimension are known.
#include "orbits/sections/delay_embedding.hpp"

#include <cmath>
#include <limits>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "orbits/sections/sampled_section.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/catch.hpp"

namespace delay_embedding_test {

using namespace orbid;
using orbits::Series;
using tests::ContainsSubstring;

namespace {

Series lorenz_x(std::size_t count) {
    const auto system = models::make_system("lorenz");
    orbits::VirtualExperimentOptions options;
    options.plan = orbits::SamplePlan{0.01, count, 2000};
    options.initial = Eigen::Vector3d(1.0, 2.0, 3.0);
    Series series = simulate(*system, system->default_parameters(), options).series;
    series.coordinates.resize(1);
    series.segments[0].values.conservativeResize(1, Eigen::NoChange);
    return series;
}

Series sine(double step) {
    Series series;
    series.sampling = Series::Sampling::samples;
    series.coordinates = {{"x", "m", false}};
    Eigen::MatrixXd values(1, 5000);
    Eigen::VectorXd times(5000);
    for (Eigen::Index i = 0; i < 5000; ++i) {
        times[i] = step * static_cast<double>(i);
        values(0, i) = std::sin(times[i]) + 0.1 * std::sin(std::numbers::sqrt2 * times[i]);
    }
    series.segments.push_back({"0", values, times, {}});
    return series;
}

}  // namespace

TEST_CASE("the Lorenz flow unfolds in three dimensions from one coordinate", "[orbits][embedding]") {
    const auto embedding = embed(lorenz_x(50000));
    CHECK(embedding.minimum_found);
    // The literature's first minimum of x at 0.16-0.17 s (Fraser and Swinney's choice for Lorenz; Abarbanel 1996: 0.1 s
    // steps of other samplings lie in 0.1-0.2 s).
    CHECK(embedding.delay >= 10);
    CHECK(embedding.delay <= 22);
    CHECK(embedding.dimension == 3);
    CHECK(embedding.unfolded);
    REQUIRE(embedding.false_neighbours.size() == 3);
    CHECK(embedding.false_neighbours[0] > 0.5);
    CHECK(embedding.series.coordinates[2].name == "x_2");
    // The vectors can be cut.
    const auto section = plane_section(embedding.series, {0, 0.0, 1});
    CHECK(section.series.size() > 100);
}

TEST_CASE("a given delay and dimension make the vectors that they say", "[orbits][embedding]") {
    Series series = sine(0.1);
    series.segments[0].values(0, 70) = std::numeric_limits<double>::quiet_NaN();
    series.segments.push_back({"short", series.segments[0].values.leftCols(10), series.segments[0].times.head(10), {}});
    const auto embedding = embed(series, {.delay = 7, .dimension = 3});
    REQUIRE(embedding.series.segments.size() == 1);
    const orbits::Segment& segment = embedding.series.segments[0];
    REQUIRE(segment.values.cols() == 4986);
    CHECK(segment.values(2, 100) == series.segments[0].values(0, 114));
    CHECK(segment.times[100] == series.segments[0].times[100]);
    CHECK(std::isnan(segment.values(1, 63)));
    CHECK(embedding.mutual_information.empty());
    CHECK(embedding.series.coordinates[1].unit == "m");
}

TEST_CASE("embeddings of senseless series are refused", "[orbits][embedding]") {
    Series series = sine(0.1);
    CHECK_THROWS_WITH(embed(series, {.coordinate = 1}), ContainsSubstring("must be in [0, 1), got 1"));
    CHECK_THROWS_WITH(embed(series, {.delay = 3000, .dimension = 3}), ContainsSubstring("no segment has the 6001"));
    CHECK_THROWS_WITH(embed(series, {.delay = -1}), ContainsSubstring("at least 0"));
    series.coordinates[0].angle = true;
    CHECK_THROWS_WITH(embed(series), ContainsSubstring("embed its sine or cosine"));
    series.sampling = Series::Sampling::section;
    CHECK_THROWS_WITH(embed(series), ContainsSubstring("holds sections"));
}

}  // namespace delay_embedding_test

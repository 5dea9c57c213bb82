// Planes chosen for motions whose return times are known.
#include "orbits/sections/plane_choice.hpp"

#include <cmath>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/catch.hpp"

namespace plane_choice_test {

using namespace orbid;
using orbits::choose_plane;
using orbits::Series;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

Series lorenz(std::size_t count, double noise) {
    const auto system = models::make_system("lorenz");
    orbits::VirtualExperimentOptions options;
    options.plan = orbits::SamplePlan{0.01, count, 2000};
    options.initial = Eigen::Vector3d(1.0, 2.0, 20.0);
    if (noise > 0.0) options.noise = Eigen::Vector3d::Constant(noise);
    return simulate(*system, system->default_parameters(), options).series;
}

Series circle() {
    Series series;
    series.sampling = Series::Sampling::samples;
    series.coordinates = {{"u", "", false}, {"v", "", false}, {"w", "", true}};
    Eigen::MatrixXd values(3, 3000);
    Eigen::VectorXd times(3000);
    for (Eigen::Index k = 0; k < 3000; ++k) {
        times[k] = 0.02 * static_cast<double>(k);
        values.col(k) << std::sin(times[k]) + 1.0, std::cos(times[k] + 0.8 * std::sin(0.7 * times[k])), times[k];
    }
    series.segments.push_back({"0", values, times, {}});
    return series;
}

}  // namespace

TEST_CASE("the evenly turning coordinate is chosen at its median", "[orbits][plane]") {
    const auto plane = choose_plane(circle());
    CHECK(plane.crossing.coordinate == 0);
    CHECK_THAT(plane.crossing.value, WithinAbs(1.0, 0.1));
    CHECK_THAT(plane.mean_return, WithinRel(2.0 * std::numbers::pi, 1e-3));
    CHECK(plane.unevenness < 0.01);
    CHECK(plane.crossings == 10);
}

TEST_CASE("a value of zero is taken where it is asked for", "[orbits][plane]") {
    Series lifted = circle();
    lifted.segments[0].values = orbits::Readings(Eigen::MatrixXd(lifted.segments[0].values.topRows(2)));
    lifted.coordinates.resize(2);
    const auto plane = choose_plane(lifted, {true, true});
    // u never falls below 0: its crossing of 0 is none.
    CHECK(plane.crossing.coordinate == 1);
    CHECK(plane.crossing.value == 0.0);
}

TEST_CASE("the Lorenz flow is cut across z, as usual", "[orbits][plane]") {
    for (const double noise : {0.0, 0.2}) {
        CAPTURE(noise);
        const auto plane = choose_plane(lorenz(50000, noise));
        CHECK(plane.crossing.coordinate == 2);
        // One return per loop: 0.7511 s in the mean at rho = 28, from the crossings of z = 27 (docs/orbits.md).
        CHECK_THAT(plane.mean_return, WithinRel(0.751, 0.03));
        CHECK(plane.unevenness < 0.25);
    }
}

TEST_CASE("motions without a plane are refused", "[orbits][plane]") {
    Series rest = circle();
    rest.segments[0].values.setConstant(2.0);
    CHECK_THROWS_AS(choose_plane(rest), orbits::DataError);
    Series few = circle();
    few.segments[0].values = orbits::Readings(Eigen::MatrixXd(few.segments[0].values.leftCols(400)));
    few.segments[0].times = Eigen::VectorXd(few.segments[0].times.head(400));
    CHECK_THROWS_AS(choose_plane(few), orbits::DataError);
    few.sampling = Series::Sampling::section;
    CHECK_THROWS_AS(choose_plane(few), std::invalid_argument);
}

}  // namespace plane_choice_test

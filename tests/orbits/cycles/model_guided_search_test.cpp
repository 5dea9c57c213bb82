#include "orbits/cycles/model_guided_search.hpp"

#include <algorithm>
#include <random>

#include "models/catalogue/registry.hpp"
#include "periodic/solution/solve_orbit.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/cycles/true_cycles.hpp"
#include "tests/orbits/sections/map_series.hpp"

namespace model_guided_search_test {

using namespace orbid;
using orbits::Cycle;

namespace {

orbits::ModelGuidedSearchOptions henon_options() {
    orbits::ModelGuidedSearchOptions options;
    options.search.periods = {1, 2, 3, 4, 5, 6, 7};
    options.search.method = orbits::CycleSearchOptions::Method::local_maps;
    options.search_points = 20000;
    return options;
}

// Largest distance of the points of a cycle to those of the model's orbit that it becomes (0.1 away at most).
double distance_to_orbit(const models::System& system, const Cycle& cycle) {
    const auto orbit =
        periodic::solve_multiple_shooting(system, system.default_parameters(), 0.0, cycle.points, {}, {});
    REQUIRE(orbit.status == periodic::OrbitStatus::converged);
    return (orbit.points - cycle.points).cwiseAbs().maxCoeff();
}

}  // namespace

TEST_CASE("harvest: what is left out of a list is found again, and nothing else", "[orbits]") {
    const auto system = models::make_system("henon");
    const auto series = tests::henon_series(20000);
    const orbits::ModelGuidedSearchOptions options = henon_options();
    const auto all = find_cycles(series, options.search).cycles;
    // Henon's map has 1, 1, 0, 1, 0, 2, 4 prime cycles of these periods on its attractor, and a fixed point off it.
    REQUIRE(all.size() == 9);
    std::vector<Cycle> known;
    for (std::size_t i = 0; i < all.size(); i += 2)
        known.push_back(all[i]);

    const auto found = model_guided_search(series, *system, system->default_parameters(), known, options);
    CHECK(found.orbits == 10);
    CHECK(found.candidates == 5);
    CHECK(found.not_visited == 1);  // the fixed point off the attractor
    CHECK(found.rejected == 0);
    CHECK(found.known == 0);
    REQUIRE(found.cycles.size() == 4);
    for (const Cycle& cycle : found.cycles) {
        // A quadratic map is fitted exactly: errors of the search on this series are 1e-13.
        CHECK(distance_to_orbit(*system, cycle) < 1e-11);
        CHECK(cycle.covariance.diagonal().minCoeff() > 0.0);
        CHECK(std::none_of(known.begin(), known.end(), [&](const Cycle& other) {
            return other.period == cycle.period && (other.points - cycle.points).norm() < 1e-6;
        }));
    }
    const auto nothing = model_guided_search(series, *system, system->default_parameters(), all, options);
    CHECK(nothing.candidates == 1);
    CHECK(nothing.cycles.empty());
}

TEST_CASE("harvest: the data decide, not the model", "[orbits]") {
    const auto system = models::make_system("henon");
    auto series = tests::henon_series(20000);
    const orbits::ModelGuidedSearchOptions options = henon_options();

    SECTION("a wrong model that is thought exact adds nothing") {
        Eigen::VectorXd wrong = system->default_parameters();
        wrong[0] *= 1.01;
        const auto found = model_guided_search(series, *system, wrong, {}, options);
        CHECK(found.cycles.empty());
        CHECK(found.rejected + found.not_visited + found.known == found.candidates);
        CHECK(found.rejected > 0);
    }
    SECTION("with errors that cover the truth it adds the data's own cycles") {
        Eigen::VectorXd wrong = system->default_parameters();
        wrong[0] *= 1.001;
        orbits::ModelGuidedSearchOptions uncertain = options;
        uncertain.free = {0};
        uncertain.covariance = Eigen::MatrixXd::Constant(1, 1, 1.4e-3 * 1.4e-3);
        const auto found = model_guided_search(series, *system, wrong, {}, uncertain);
        CHECK(found.cycles.size() == 9);
        for (const Cycle& cycle : found.cycles)
            CHECK(distance_to_orbit(*system, cycle) < 1e-11);
    }
    SECTION("shuffled points have no cycles") {
        std::mt19937_64 random(3);
        orbits::Readings& values = series.segments[0].values;
        for (Eigen::Index i = values.cols() - 1; i > 0; --i)
            values.col(i).swap(values.col(static_cast<Eigen::Index>(random() % static_cast<std::uint64_t>(i + 1))));
        const auto found = model_guided_search(series, *system, system->default_parameters(), {}, options);
        CHECK(found.candidates == 10);
        CHECK(found.cycles.empty());
        CHECK(found.remarks.size() == 1);
    }
}

TEST_CASE("harvest: cycles of the pendulum that do not recur within a narrow box", "[orbits]") {
    const auto system = models::make_system("parametric_pendulum");
    const Eigen::VectorXd theta = tests::pendulum_at(*system, 0.0);
    const auto series = tests::pendulum_record(*system, std::size_t{1} << 15, 0.0, 1);
    orbits::ModelGuidedSearchOptions options;
    options.search.method = orbits::CycleSearchOptions::Method::local_maps;
    options.search.periods = {1, 2, 3};
    options.search.box = 0.01;
    options.search.symmetry_signs = system->symmetry()->signs;
    options.search_points = 20000;
    const auto known = find_cycles(series, options.search).cycles;
    const auto found = model_guided_search(series, *system, theta, known, options);
    CHECK(found.cycles.size() > known.size());
    CHECK(found.not_visited + found.rejected + found.known < found.candidates);
    std::vector<Cycle> both = known;
    both.insert(both.end(), found.cycles.begin(), found.cycles.end());
    for (const auto& truth : tests::true_cycles(*system, theta, both, tests::pendulum_range())) {
        CHECK(truth.is_true);
        CHECK_FALSE(truth.repeated);
    }
    for (std::size_t i = 0; i < found.cycles.size(); ++i) {
        REQUIRE(found.cycles[i].mirror);
        CHECK(found.cycles.at(*found.cycles[i].mirror).mirror == i);
    }
}

TEST_CASE("harvest: crossings of a plane, of which the series lacks a coordinate", "[orbits]") {
    const auto system = models::make_system("lorenz");
    const Eigen::VectorXd theta = system->default_parameters();
    const models::Section plane{Eigen::Vector3d(0.0, 0.0, 1.0), 27.0, 1};
    orbits::VirtualExperimentOptions experiment;
    experiment.plan = orbits::SectionPlan{.sections = 20000, .transient = 100, .section = plane};
    auto series = simulate(*system, theta, experiment).series;
    series.coordinates.pop_back();
    for (orbits::Segment& segment : series.segments)
        segment.values = segment.values.topRows(2).eval();
    orbits::ModelGuidedSearchOptions options;
    options.search.method = orbits::CycleSearchOptions::Method::local_maps;
    options.search.periods = {2, 3};
    options.search_points = 20000;
    options.section = plane;
    // Orbits through the wings A and B: AB, and AAB with its mirror image ABB.
    const auto found = model_guided_search(series, *system, theta, {}, options);
    CHECK(found.orbits == 3);
    REQUIRE(found.cycles.size() == 3);
    for (const Cycle& cycle : found.cycles) {
        CAPTURE(cycle.period);
        periodic::StartingSolution start;
        start.points = Eigen::MatrixXd::Constant(3, cycle.period, 27.0);
        start.points.topRows(2) = cycle.points;
        start.section = plane;
        const auto orbit = periodic::solve_orbit(*system, theta, start, {});
        REQUIRE(orbit.status == periodic::OrbitStatus::converged);
        const Eigen::MatrixXd error = orbit.points.topRows(2) - cycle.points;
        for (Eigen::Index k = 0; k < error.size(); ++k)
            CHECK(std::abs(error(k % 2, k / 2)) < 4.0 * std::sqrt(cycle.covariance(k, k)) + 1e-8);
        CHECK(std::abs(cycle.time / orbit.time - 1.0) < 1e-4);
    }
    CHECK(model_guided_search(series, *system, theta, found.cycles, options).candidates == 0);
}

TEST_CASE("harvest: wrong calls are refused", "[orbits]") {
    const auto system = models::make_system("henon");
    const auto series = tests::henon_series(2000);
    const Eigen::VectorXd theta = system->default_parameters();
    orbits::ModelGuidedSearchOptions options = henon_options();

    options.search.periods.clear();
    CHECK_THROWS_WITH(model_guided_search(series, *system, theta, {}, options), tests::ContainsSubstring("periods"));
    options = henon_options();
    options.covariance = Eigen::MatrixXd::Identity(2, 2);
    CHECK_THROWS_WITH(model_guided_search(series, *system, theta, {}, options),
                      tests::ContainsSubstring("0 free parameters"));
    options = henon_options();
    options.free = {0};
    options.covariance = Eigen::MatrixXd::Constant(1, 1, -1.0);
    CHECK_THROWS_WITH(model_guided_search(series, *system, theta, {}, options), tests::ContainsSubstring("variances"));
    options = henon_options();
    options.search.method = orbits::CycleSearchOptions::Method::closest_return;
    CHECK_THROWS_WITH(model_guided_search(series, *system, theta, {}, options),
                      tests::ContainsSubstring("closest_return"));
    options = henon_options();
    options.section = models::Section{Eigen::Vector2d(1.0, 0.0), 0.0, 1};
    CHECK_THROWS_WITH(model_guided_search(series, *system, theta, {}, options),
                      tests::ContainsSubstring("not autonomous"));
    auto other = series;
    other.coordinates[0].name = "u";
    CHECK_THROWS_WITH(model_guided_search(other, *system, theta, {}, henon_options()), tests::ContainsSubstring("'u'"));
    CHECK_THROWS_WITH(model_guided_search(series, *models::make_system("lorenz"),
                                          models::make_system("lorenz")->default_parameters(), {}, henon_options()),
                      tests::ContainsSubstring("plane"));
}

}  // namespace model_guided_search_test

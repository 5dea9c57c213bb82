// All orbits of a model without data: completeness where theory gives the numbers, the reference tables, refusals.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <numeric>
#include <stdexcept>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "models/registry.hpp"
#include "periodic/orbit_search.hpp"
#include "tests/catch.hpp"
#include "tests/periodic/flow_orbits.hpp"
#include "tests/periodic/reference_orbits.hpp"

namespace {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using periodic::FoundOrbit;
using periodic::OrbitSearch;
using periodic::OrbitSearchOptions;

std::vector<int> up_to(int longest) {
    std::vector<int> periods(static_cast<std::size_t>(longest));
    std::iota(periods.begin(), periods.end(), 1);
    return periods;
}

std::vector<int> counts(const OrbitSearch& search, int longest) {
    std::vector<int> number(static_cast<std::size_t>(longest), 0);
    for (const FoundOrbit& found : search.orbits)
        ++number[static_cast<std::size_t>(found.orbit.period - 1)];
    return number;
}

/// Largest difference of the points, over the best cyclic shift; angles in the first coordinate.
double distance(const MatrixXd& a, const MatrixXd& b, bool angle) {
    double best = INFINITY;
    for (Index shift = 0; shift < a.cols() && a.cols() == b.cols(); ++shift) {
        double largest = 0.0;
        for (Index j = 0; j < a.cols(); ++j)
            for (Index i = 0; i < a.rows(); ++i) {
                double gap = a(i, j) - b(i, (j + shift) % b.cols());
                if (angle && i == 0) gap = models::wrapped(gap);
                largest = std::max(largest, std::abs(gap));
            }
        best = std::min(best, largest);
    }
    return best;
}

}  // namespace

TEST_CASE("search finds every cycle of the logistic map at r = 4", "[periodic][search]") {
    const auto logistic = models::make_system("logistic");
    OrbitSearchOptions options;
    options.periods = up_to(8);
    options.points = 1U << 15U;
    const OrbitSearch search = search_orbits(*logistic, logistic->default_parameters(), options);
    // Binary necklaces, all cycles unstable.
    CHECK(counts(search, 8) == std::vector<int>{2, 1, 2, 3, 6, 9, 18, 30});
    for (const FoundOrbit& found : search.orbits) {
        const int p = found.orbit.period;
        // +-2^p; at x = 0 the slope is 4 instead.
        const double expected = p == 1 && found.orbit.points(0, 0) < 0.1 ? 4.0 : std::ldexp(1.0, p);
        CAPTURE(p, found.orbit.points(0, 0));
        CHECK(std::abs(std::abs(found.orbit.multipliers.at(0)) / expected - 1.0) < 1e-10);
    }
}

TEST_CASE("search without data finds the pendulum's cycles", "[periodic][search][reference]") {
    const auto pendulum = models::make_system("parametric_pendulum");
    const auto table = tests::read_reference_orbits(*pendulum, "pendulum_orbits_g9.81.json");
    OrbitSearchOptions options;
    options.periods = {1, 2, 3};
    const OrbitSearch search = search_orbits(*pendulum, table.theta, options);
    CHECK(counts(search, 3) == std::vector<int>{6, 9, 28});
    for (const auto& reference : table.orbits) {
        if (reference.period > 3) continue;
        CAPTURE(reference.period, reference.rotation, reference.unstable_multiplier);
        double nearest = INFINITY;
        double mirrored = INFINITY;
        for (const FoundOrbit& found : search.orbits) {
            nearest = std::min(nearest, distance(found.orbit.points, reference.points, true));
            mirrored = std::min(mirrored, distance(found.orbit.points, -reference.points, true));
        }
        // Digits of the table.
        CHECK(nearest < 1e-11);
        CHECK(mirrored < 1e-11);
    }
    for (std::size_t k = 0; k < search.orbits.size(); ++k) {
        const int mirror = search.orbits[k].mirror;
        REQUIRE(mirror >= 0);
        CHECK(search.orbits[static_cast<std::size_t>(mirror)].mirror == static_cast<int>(k));
    }
}

TEST_CASE("search for orbits refuses wrong options", "[periodic][search]") {
    const auto lorenz = models::make_system("lorenz");
    const auto henon = models::make_system("henon");
    const auto refused = [](const models::System& system, auto change) {
        OrbitSearchOptions options;
        change(options);
        CHECK_THROWS_AS(search_orbits(system, system.default_parameters(), options), std::invalid_argument);
    };
    refused(*lorenz, [](OrbitSearchOptions&) {});  // no section
    refused(*henon, [](OrbitSearchOptions& o) { o.section = models::Section{Eigen::Vector2d::UnitX(), 0.0, 1}; });
    refused(*henon, [](OrbitSearchOptions& o) { o.periods = {}; });
    refused(*henon, [](OrbitSearchOptions& o) { o.periods = {0}; });
    refused(*henon, [](OrbitSearchOptions& o) { o.periods = {2, 2}; });
    refused(*henon, [](OrbitSearchOptions& o) { o.points = 99; });
    refused(*henon, [](OrbitSearchOptions& o) { o.trajectories = 0; });
    refused(*henon, [](OrbitSearchOptions& o) { o.widest = 0.6; });
    refused(*henon, [](OrbitSearchOptions& o) { o.widest = std::nan(""); });
    refused(*henon, [](OrbitSearchOptions& o) { o.patience = 0; });
    refused(*henon, [](OrbitSearchOptions& o) { o.phase = std::nan(""); });
    refused(*henon, [](OrbitSearchOptions& o) { o.initial = MatrixXd::Zero(3, 1); });
    CHECK_THROWS_AS(search_orbits(*henon, VectorXd::Zero(1), OrbitSearchOptions{}), std::invalid_argument);
}

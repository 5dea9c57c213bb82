// All orbits of a model without data: completeness where theory gives the numbers, the reference tables, refusals.
#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <numeric>
#include <stdexcept>
#include <string>
#include <vector>

#include <tbb/global_control.h>
#include <nlohmann/json.hpp>

#include "models/catalogue/registry.hpp"
#include "periodic/search/index_sum.hpp"
#include "periodic/search/orbit_search.hpp"
#include "tests/catch.hpp"
#include "tests/periodic/orbit/flow_orbits.hpp"
#include "tests/periodic/orbit/reference_orbits.hpp"
#include "tests/source_folder.hpp"

namespace orbit_search_test {

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
    options.points = 1U << 16U;
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

TEST_CASE("search finds every cycle of Henon's map, also off the attractor", "[periodic][search][reference]") {
    const auto henon = models::make_system("henon");
    std::ifstream stream(orbid::tests::source_folder() + "/tests/reference/henon_cycles.json");
    const auto table = nlohmann::json::parse(stream);
    OrbitSearchOptions options;
    options.periods = up_to(10);
    options.points = 1U << 14U;
    options.stabilised = false;
    const OrbitSearch search = search_orbits(*henon, henon->default_parameters(), options);
    std::vector<int> expected;
    for (const int p : options.periods)
        expected.push_back(table.at("prime_cycle_count").at(std::to_string(p)).get<int>());
    CHECK(counts(search, 10) == expected);
    CHECK(search.settled == std::vector<bool>(10, true));
    for (const auto& cycle : table.at("cycles")) {
        const Eigen::Vector2d x(std::stod(cycle.at("x").get<std::string>()),
                                std::stod(cycle.at("y").get<std::string>()));
        CAPTURE(x(0), cycle.at("period").get<int>());
        double nearest = INFINITY;
        for (const FoundOrbit& found : search.orbits)
            if (found.orbit.period == cycle.at("period").get<int>())
                nearest =
                    std::min(nearest, (found.orbit.points.colwise() - x).cwiseAbs().colwise().maxCoeff().minCoeff());
        CHECK(nearest < 1e-13);  // rounding: measured 1e-14 times ten
    }
}

TEST_CASE("search finds Ikeda's cycles", "[periodic][search][reference]") {
    const auto ikeda = models::make_system("ikeda");
    OrbitSearchOptions options;
    options.periods = up_to(7);
    options.points = 1U << 14U;
    options.stabilised = false;
    const OrbitSearch search = search_orbits(*ikeda, ikeda->default_parameters(), options);
    std::vector<int> unstable(7, 0), stable(7, 0);
    std::vector<periodic::PeriodicOrbit> orbits;
    for (const FoundOrbit& found : search.orbits) {
        auto& number = std::abs(found.orbit.multipliers.at(0)) > 1.0 ? unstable : stable;
        ++number[static_cast<std::size_t>(found.orbit.period - 1)];
        orbits.push_back(found.orbit);
    }
    CHECK(unstable == std::vector<int>{2, 1, 2, 3, 4, 7, 10});
    // Beside the chaos there is a stable fixed point.
    CHECK(stable == std::vector<int>{1, 0, 0, 0, 0, 0, 0});
    // The plane is mapped into a disc: all indices add up to 1.
    CHECK(index_sums(orbits, 7) == std::vector<int>(7, 1));
}

TEST_CASE("search finds the orbits of Lorenz' and Roessler's flows", "[periodic][search][reference]") {
    const auto check = [](const std::string& model, const periodic::SymbolPartition& partition, int longest,
                          const std::vector<int>& expected) {
        const auto system = models::make_system(model);
        const auto table = tests::read_flow_orbits(model);
        OrbitSearchOptions options;
        options.periods = up_to(longest);
        options.section = table.section;
        options.partition = partition;
        options.points = 1U << 12U;
        options.stabilised = false;
        options.loops = 300;
        const OrbitSearch search = search_orbits(*system, system->default_parameters(), options);
        CAPTURE(model);
        CHECK(counts(search, longest) == expected);
        for (const auto& reference : table.orbits) {
            CAPTURE(reference.code);
            bool met = false;
            for (const FoundOrbit& found : search.orbits)
                if (periodic::same_cyclic_word(found.code, reference.code)) {
                    // As autonomous_orbits_test.cpp, for any start.
                    CHECK(std::abs(found.orbit.time / reference.time - 1.0) < 1e-13);
                    met = true;
                }
            CHECK(met);
        }
    };
    // Binary words but A and B, which have shrunk to the equilibria.
    check("lorenz", {{{0, {0.0}}}, "AB"}, 5, {0, 1, 2, 3, 6});
    // The top of the return map lies at y = 4.95 (symbolic_start_test.cpp finds it).
    check("rossler", {{{1, {4.95}}}, "01"}, 7, {1, 1, 2, 1, 2, 3, 4});
}

TEST_CASE("a search that is asked to stop returns what it has", "[periodic][search]") {
    const auto henon = models::make_system("henon");
    OrbitSearchOptions options;
    options.periods = up_to(8);
    options.points = 1U << 12U;
    const OrbitSearch whole = search_orbits(*henon, henon->default_parameters(), options);
    CHECK_FALSE(whole.interrupted);
    int asked = 0;
    options.interrupted = [&] { return ++asked > 6; };
    const OrbitSearch part = search_orbits(*henon, henon->default_parameters(), options);
    CHECK(part.interrupted);
    CHECK_FALSE(part.orbits.empty());
    CHECK(part.orbits.size() < whole.orbits.size());
    REQUIRE(part.settled.size() == 8);
    CHECK_FALSE(part.settled.back());
}

TEST_CASE("points of orbits found pass the section in its direction", "[periodic][search]") {
    // Scattered starts lie on both sides of the plane, and an orbit passes it as often one way as the other.
    const auto system = models::make_system("rossler");
    const Eigen::VectorXd theta = system->default_parameters();
    OrbitSearchOptions options;
    options.periods = {1, 2, 3};
    options.section = models::Section{Eigen::Vector3d::UnitY(), 0.0, 1};
    options.points = 1U << 12U;
    options.stabilised = false;
    const OrbitSearch search = search_orbits(*system, theta, options);
    CHECK(counts(search, 3) == std::vector<int>{1, 1, 2});
    for (const FoundOrbit& found : search.orbits) {
        const Eigen::MatrixXd& points = found.orbit.points;
        const std::vector<double> phases(static_cast<std::size_t>(points.cols()), 0.0);
        CAPTURE(found.orbit.period, points);
        CHECK(system->rhs(points, phases, theta).row(1).minCoeff() > 0.0);
    }
}

TEST_CASE("indices of a complete list of orbits of the pendulum add up to the same number", "[periodic][search]") {
    const auto pendulum = models::make_system("parametric_pendulum");
    const auto table = tests::read_reference_orbits(*pendulum, "pendulum_orbits_g9.81.json");
    OrbitSearchOptions options;
    options.periods = {1, 2, 3, 4};
    options.points = 1U << 16U;
    options.stabilised = false;
    const OrbitSearch search = search_orbits(*pendulum, table.theta, options);
    std::vector<periodic::PeriodicOrbit> orbits;
    for (const FoundOrbit& found : search.orbits)
        orbits.push_back(found.orbit);
    // A cylinder is mapped into itself: its Euler characteristic.
    CHECK(index_sums(orbits, 4) == std::vector<int>(4, 0));
    CHECK(counts(search, 4) == std::vector<int>{6, 9, 28, 98});
    orbits.pop_back();
    CHECK(index_sums(orbits, 4).back() != 0);
}

TEST_CASE("search finds orbits where a period stretches by more than ten", "[periodic][search]") {
    // The pendulum driven by a torque. 12 orbits of period 1 and 50 of period 2 are also found from 2^17 to
    // 2^19 points; with trajectories on the attractor alone there were 40, and the sums of indices 0 and 4.
    const auto system = models::make_system("driven_pendulum");
    periodic::OrbitSearchOptions options;
    options.periods = {1, 2};
    const auto found = periodic::search_orbits(*system, system->default_parameters(), options);
    std::vector<periodic::PeriodicOrbit> orbits;
    std::array<int, 3> counts{};
    for (const auto& entry : found.orbits) {
        orbits.push_back(entry.orbit);
        ++counts[static_cast<std::size_t>(entry.orbit.period)];
    }
    CHECK(counts[1] == 12);
    CHECK(counts[2] == 50);
    CHECK(periodic::index_sums(orbits, 2) == std::vector<int>{0, 0});
    CHECK(found.settled == std::vector<bool>{true, true});
}

TEST_CASE("search gives the same bytes with any number of threads", "[periodic][search][threads]") {
    const auto pendulum = models::make_system("parametric_pendulum");
    const auto table = tests::read_reference_orbits(*pendulum, "pendulum_orbits_g9.81.json");
    OrbitSearchOptions options;
    options.periods = {2, 3};
    options.points = 1U << 13U;
    std::vector<OrbitSearch> searches;
    for (const std::size_t threads : {1, 4}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        searches.push_back(search_orbits(*pendulum, table.theta, options));
    }
    REQUIRE(searches[0].orbits.size() == searches[1].orbits.size());
    CHECK_FALSE(searches[0].orbits.empty());
    CHECK(searches[0].starts == searches[1].starts);
    for (std::size_t k = 0; k < searches[0].orbits.size(); ++k) {
        const FoundOrbit& one = searches[0].orbits[k];
        const FoundOrbit& four = searches[1].orbits[k];
        CHECK(one.orbit.points == four.orbit.points);
        CHECK(one.orbit.multipliers == four.orbit.multipliers);
        CHECK(one.origin == four.origin);
        CHECK(one.hits == four.hits);
        CHECK(one.mirror == four.mirror);
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
    refused(*henon, [](OrbitSearchOptions& o) { o.loops = 0; });
    refused(*henon, [](OrbitSearchOptions& o) { o.codes = {"0"}; });
    refused(*henon, [](OrbitSearchOptions& o) {
        o.partition = periodic::SymbolPartition{{{0, {0.0}}}, "01"};
        o.codes = {"0101"};
    });
    refused(*henon, [](OrbitSearchOptions& o) { o.initial = MatrixXd::Zero(3, 1); });
    CHECK_THROWS_AS(search_orbits(*henon, VectorXd::Zero(1), OrbitSearchOptions{}), std::invalid_argument);
}

}  // namespace orbit_search_test

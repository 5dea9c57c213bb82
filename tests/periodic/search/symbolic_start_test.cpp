// Orbits from their symbol sequences: every coded orbit of the tables of Lorenz and Roessler, the pendulum, refusals.
#include <cmath>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "models/catalogue/registry.hpp"
#include "periodic/search/symbolic_start.hpp"
#include "periodic/solution/multiple_shooting.hpp"
#include "tests/catch.hpp"
#include "tests/periodic/orbit/flow_orbits.hpp"
#include "tests/periodic/orbit/reference_orbits.hpp"

namespace symbolic_start_test {

namespace {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using periodic::SymbolPartition;

/// Smallest distance of a point to those of an orbit, largest coordinate.
double distance(const MatrixXd& points, const VectorXd& x) {
    return (points.colwise() - x).cwiseAbs().colwise().maxCoeff().minCoeff();
}

struct Simulated {
    std::shared_ptr<const models::System> system;
    VectorXd theta;
    tests::FlowOrbits table;
    periodic::ModelSection section;
    periodic::SectionPieces pieces;

    explicit Simulated(const std::string& model)
        : system(models::make_system(model)),
          theta(system->default_parameters()),
          table(tests::read_flow_orbits(model)),
          section{*system, theta, 0.0, table.section,
                  periodic::longest_return(*system, theta, table.section, 1, models::FlowOptions{1e-8, 1e-8})},
          pieces(periodic::simulate_pieces(section, {1U << 14U, 16, 1, {}, models::FlowOptions{1e-8, 1e-8}})) {}
};

void check_table(const Simulated& simulated, const SymbolPartition& partition) {
    const periodic::SymbolicStarts starts(simulated.section, simulated.pieces, partition);
    REQUIRE_FALSE(simulated.table.orbits.empty());
    for (const auto& reference : simulated.table.orbits) {
        CAPTURE(reference.code);
        const auto coded = starts.solve(reference.code, {});
        CHECK(coded.found);
        CHECK(coded.agreement >= static_cast<int>(reference.code.size()));
        CHECK(periodic::same_cyclic_word(coded.code, reference.code));
        // autonomous_orbits_test.cpp asserts 1e-14 for starts nearby.
        CHECK(std::abs(coded.orbit.time / reference.time - 1.0) < 1e-13);
        CHECK(distance(coded.orbit.points, reference.point) < 1e-9);
    }
}

}  // namespace

TEST_CASE("every orbit of Lorenz' table is reached from its code", "[periodic][symbolic][reference]") {
    // Left and right wing.
    check_table(Simulated("lorenz"), {{{0, {0.0}}}, "AB"});
}

TEST_CASE("every orbit of Roessler's table is reached from its code", "[periodic][symbolic][reference]") {
    const Simulated simulated("rossler");
    // The return map of y has one hump: its top, the point with the largest image, tells 0 from 1.
    double top = 0.0;
    double image = -INFINITY;
    for (const MatrixXd& piece : simulated.pieces.pieces)
        for (Index k = 200; k + 1 < piece.cols(); ++k)
            if (piece(1, k + 1) > image) {
                image = piece(1, k + 1);
                top = piece(1, k);
            }
    check_table(simulated, {{{1, {top}}}, "01"});
}

TEST_CASE("every cycle of the pendulum to period 3 is reached from its code", "[periodic][symbolic][reference]") {
    const auto pendulum = models::make_system("parametric_pendulum");
    const auto table = tests::read_reference_orbits(*pendulum, "pendulum_orbits_g9.81.json");
    const periodic::ModelSection section{*pendulum, table.theta, 0.0, std::nullopt, 1.0};
    const auto pieces = periodic::simulate_pieces(section, {1U << 17U, 256, 1, {}, models::FlowOptions{1e-8, 1e-8}});
    const auto partition = periodic::quarter_turn_partition(0, 1, {-10.0, -6.0, -2.0, 2.0, 6.0, 10.0});
    const periodic::SymbolicStarts starts(section, pieces, partition);
    std::set<std::string> words;
    REQUIRE_FALSE(table.orbits.empty());
    for (const auto& reference : table.orbits) {
        std::string word = periodic::symbolic_code(partition, reference.points);
        CAPTURE(word, reference.period, reference.rotation);
        REQUIRE(periodic::is_prime_word(word));
        const auto coded = starts.solve(word, {});
        REQUIRE(coded.found);
        for (Index j = 0; j < reference.points.cols(); ++j) {
            MatrixXd gap = coded.orbit.points.colwise() - reference.points.col(j);
            for (double& angle : gap.row(0).reshaped())
                angle = models::wrapped(angle);
            CHECK(gap.cwiseAbs().colwise().maxCoeff().minCoeff() < 1e-11);  // digits of the table
        }
        for (std::size_t shift = 1; shift < word.size(); ++shift)
            CHECK(words.count(word.substr(shift) + word.substr(0, shift)) == 0);
        CHECK(words.insert(word).second);
    }
}

TEST_CASE("orbits from codes refuse wrong words and partitions", "[periodic][symbolic]") {
    const auto henon = models::make_system("henon");
    const VectorXd theta = henon->default_parameters();
    const periodic::ModelSection section{*henon, theta, 0.0, std::nullopt, 1.0};
    const auto pieces = periodic::simulate_pieces(section, {1000, 4, 1, {}, {}});
    const periodic::SymbolicStarts starts(section, pieces, {{{0, {0.0}}}, "01"});
    CHECK_THROWS_AS(starts.solve("", {}), std::invalid_argument);
    CHECK_THROWS_AS(starts.solve("0101", {}), std::invalid_argument);
    CHECK_THROWS_AS(starts.solve("012", {}), std::invalid_argument);
    // Two points on the left in a row leave the attractor.
    CHECK_FALSE(starts.solve("00001", {}).found);
    const auto refused = [&](const SymbolPartition& partition) {
        CHECK_THROWS_AS(periodic::SymbolicStarts(section, pieces, partition), std::invalid_argument);
    };
    refused({{}, "0"});
    refused({{{2, {0.0}}}, "01"});
    refused({{{0, {0.0}}}, "0"});
    refused({{{0, {0.0}}}, "000"});
    refused({{{0, {1.0, 0.0}}}, "012"});
    refused({{{0, {std::nan("")}}}, "01"});
    refused({{{0, {}}}, "0"});
    refused({{{0, {0.0}}, {0, {1.0}}}, "0123"});
    CHECK_THROWS_AS(periodic::quarter_turn_partition(0, 1, {}), std::invalid_argument);
}

}  // namespace symbolic_start_test

#include "orbits/local_maps/cell_map.hpp"

#include <cmath>
#include <random>

#include "orbits/cycles/cycle_refinement.hpp"
#include "orbits/local_maps/fit_choice.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/sections/map_series.hpp"

namespace cell_map_test {

using namespace orbid;
using orbits::CellMap;
using orbits::NeighbourIndex;
using orbits::SectionPoints;

TEST_CASE("cells know the map and its derivative where there are points", "[orbits][cell_map]") {
    constexpr double turn = 2.0 * std::numbers::pi;
    const SectionPoints section(tests::standard_map_series(1 << 15));
    const NeighbourIndex grid(section);
    const CellMap map(section, grid, 0, 0);
    const CellMap again(section, grid, 0, 0);
    std::array<double, 2> image{}, other{};
    std::array<double, 4> jacobian{};
    std::vector<double> values(static_cast<std::size_t>(map.terms()));
    double worst = 0.0, worst_slope = 0.0;
    int usable = 0;
    for (std::size_t i = 0; i + 1 < section.size(); i += 16) {
        // the same cells in the other order must hold the same numbers
        (void)again.cell_of(section.point(section.size() - 2 - i));
        const auto& cell = map.cell_of(section.point(i));
        if (!cell.usable) continue;
        ++usable;
        map.evaluate(cell, section.point(i), image.data(), jacobian.data(), values.data());
        for (Eigen::Index d = 0; d < 2; ++d)
            worst = std::max(
                worst, std::abs(section.difference(image[static_cast<std::size_t>(d)], section.point(i + 1)[d], d)));
        const double slope = 7.0 * std::cos(turn * section.point(i)[0]);
        worst_slope = std::max(worst_slope, std::abs(jacobian[0] - 1.0 - slope) + std::abs(jacobian[1] - slope) +
                                                std::abs(jacobian[2] - 1.0) + std::abs(jacobian[3] - 1.0));
    }
    CHECK(usable > 1900);  // of 2048; cells at the edge of the islands have few points
    // Truncation of quadratic polynomials over cells of 1/128, measured 3e-5 and 0.021; bounds are ten times that.
    CHECK(worst < 3e-4);
    CHECK(worst_slope < 0.21);
    for (std::size_t i = 0; i + 1 < section.size(); i += 160) {
        const auto& cell = map.cell_of(section.point(i));
        const auto& twin = again.cell_of(section.point(i));
        REQUIRE(cell.usable == twin.usable);
        if (!cell.usable) continue;
        map.evaluate(cell, section.point(i), image.data(), jacobian.data(), values.data());
        again.evaluate(twin, section.point(i), other.data(), jacobian.data(), values.data());
        CHECK(image == other);
    }
}

TEST_CASE("Newton on cells finds the fixed point, and no map away from the data", "[orbits][cell_map]") {
    const auto series = tests::henon_series(1 << 14);
    const SectionPoints section(series);
    const NeighbourIndex grid(section);
    const CellMap map(section, grid, 0, 0);
    const Eigen::Vector2d fixed(0.6313544770895048, 0.18940634312685141);
    Eigen::MatrixXd start = (fixed + Eigen::Vector2d(0.02, 0.003)).cwiseQuotient(section.scale());
    REQUIRE(close_on_cells(section, map, start));
    // quadratic polynomials of a quadratic map: rounding over the neighbourhoods
    CHECK((section.scale().asDiagonal() * start - fixed).cwiseAbs().maxCoeff() < 1e-10);

    // Far from the attractor noisy neighbours on one side tell nothing. (Without noise quadratic polynomials are right
    // everywhere.)
    auto noisy = series;
    std::mt19937_64 random(4);
    std::normal_distribution<double> normal;
    orbits::Readings& values = noisy.segments[0].values;
    for (Eigen::Index i = 0; i < values.size(); ++i)
        values.data()[i] += 1e-3 * normal(random);
    const SectionPoints blurred(noisy);
    const NeighbourIndex blurred_grid(blurred);
    const CellMap blurred_map(blurred, blurred_grid, 0, 0);
    const Eigen::Vector2d away(0.0, 0.9);
    CHECK_FALSE(blurred_map.cell_of(away.data()).usable);
    Eigen::MatrixXd lost = away;
    CHECK_FALSE(close_on_cells(blurred, blurred_map, lost));
}

TEST_CASE("cells of shuffled points know nothing", "[orbits][cell_map]") {
    auto series = tests::standard_map_series(1 << 14);
    orbits::Readings& values = series.segments[0].values;
    std::mt19937_64 random(2);
    for (Eigen::Index i = values.cols() - 1; i > 0; --i)
        values.col(i).swap(values.col(static_cast<Eigen::Index>(random() % static_cast<std::uint64_t>(i + 1))));
    const SectionPoints section(series);
    const NeighbourIndex grid(section);
    const CellMap map(section, grid, 0, 0);
    for (std::size_t i = 0; i < section.size(); i += 64)
        CHECK_FALSE(map.cell_of(section.point(i)).usable);
}

TEST_CASE("order and neighbours follow the data", "[orbits][fit_choice]") {
    const auto clean = tests::standard_map_series(1 << 15);
    const Eigen::Vector2d place(0.11, -0.23);
    std::size_t before = 0;
    for (const double noise : {0.0, 1e-4, 3e-3}) {
        CAPTURE(noise);
        auto series = clean;
        std::mt19937_64 random(5);
        std::normal_distribution<double> normal;
        orbits::Readings& values = series.segments[0].values;
        for (Eigen::Index i = 0; i < values.size(); ++i)
            values.data()[i] += noise * normal(random);
        const SectionPoints section(series);
        const NeighbourIndex grid(section);
        const orbits::FitChoice choice(section, grid, 0, 0);
        const auto sizes = choice.best(place);
        REQUIRE(sizes.size() == 3);
        CHECK(sizes[1].order != sizes[0].order);
        CHECK(sizes[2].order == sizes[0].order);
        CHECK(sizes[2].neighbours != sizes[0].neighbours);
        if (noise == 0.0) CHECK(sizes[0].order >= 4);
        CHECK(sizes[0].neighbours > before);  // more noise, more neighbours
        before = sizes[0].neighbours;

        const auto fits = choice.fitted(place, sizes);
        const double turn = 2.0 * std::numbers::pi;
        const std::array<double, 2> exact = tests::standard_map({turn * place[0], turn * place[1]});
        for (const orbits::LocalMap& fit : fits.fits) {
            REQUIRE(fit.usable);
            for (Eigen::Index d = 0; d < 2; ++d)
                CHECK(std::abs(section.difference(fit.value[d], exact[static_cast<std::size_t>(d)] / turn, d)) <
                      6.0 * fit.value_sd);
        }
        const auto given = orbits::FitChoice(section, grid, 3, 0).best(place);
        CHECK(given.at(0).order == 3);
        const auto both = orbits::FitChoice(section, grid, 2, 25).best(place);
        REQUIRE(both.size() == 1);
        CHECK(both[0].order == 2);
        CHECK(both[0].neighbours == 25);
    }
}

}  // namespace cell_map_test

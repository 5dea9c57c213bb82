#include "orbits/local_maps/cycle_multiplier.hpp"

#include <cmath>

#include "tests/catch.hpp"

namespace cycle_multiplier_test {

using namespace orbid;
using tests::WithinRel;

TEST_CASE("multipliers of triangular factors are the products of the diagonals", "[orbits][multiplier]") {
    // The product's small multiplier 1e-40 is far below the rounding of its large one, 1e40.
    std::vector<Eigen::MatrixXd> factors;
    const Eigen::Matrix2d turned{{0.6, -0.8}, {0.8, 0.6}};
    for (int j = 0; j < 40; ++j)
        factors.emplace_back(turned * Eigen::Matrix2d{{-10.0, 3.0}, {0.0, 0.1}} * turned.transpose());
    const auto result = orbits::cycle_multipliers(factors);
    CHECK_THAT(result.values[0].real(), WithinRel(1e40, 1e-12));
    CHECK_THAT(result.values[1].real(), WithinRel(1e-40, 1e-12));
    CHECK_THAT(result.ln_modulus[1], WithinRel(-40.0 * std::log(10.0), 1e-13));
    factors.pop_back();
    CHECK_THAT(orbits::cycle_multipliers(factors).values[0].real(), WithinRel(-1e39, 1e-12));
}

TEST_CASE("complex and equal multipliers", "[orbits][multiplier]") {
    const Eigen::Matrix2d spiral{{0.5, -2.0}, {2.0, 0.5}};
    const auto pair = orbits::cycle_multipliers({spiral, spiral});
    const std::complex<double> expected = std::complex<double>(0.5, 2.0) * std::complex<double>(0.5, 2.0);
    CHECK_THAT(std::abs(pair.values[0] - std::complex<double>(expected.real(), std::abs(expected.imag()))),
               tests::WithinAbs(0.0, 1e-13));
    CHECK(pair.values[1] == std::conj(pair.values[0]));
    const auto opposite = orbits::cycle_multipliers({Eigen::Matrix2d{{0.0, 3.0}, {3.0, 0.0}}});
    CHECK_THAT(std::abs(opposite.values[0]), WithinRel(3.0, 1e-13));
    CHECK_THAT(opposite.values[0].real() * opposite.values[1].real(), WithinRel(-9.0, 1e-13));
}

}  // namespace cycle_multiplier_test

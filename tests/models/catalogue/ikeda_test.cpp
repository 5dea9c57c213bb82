#include "models/catalogue/ikeda.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>
#include <complex>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"

namespace orbid::models::ikeda_test {

static_assert(MapModel<Ikeda>);

using tests::WithinAbs;

TEST_CASE("the Ikeda map has its fixed point and multipliers", "[models][reference]") {
    // An independent computation in extended precision.
    const Eigen::Vector2d fixed(0.53275462294079024, 0.24689677271101318);
    const auto system = make_system("ikeda");
    const auto flow =
        system->flow_with_sensitivities(fixed, 0.0, std::array{1.0}, system->default_parameters(), {}, Clock::time);
    // Roundings of numbers of size one.
    CHECK((flow.states.col(0) - fixed).norm() < 1e-15);
    const Eigen::Vector2cd multipliers = flow.sensitivities.eigenvalues();
    CHECK_THAT(std::min(multipliers[0].real(), multipliers[1].real()), WithinAbs(-2.38968679322807, 1e-14));
    CHECK_THAT(std::max(multipliers[0].real(), multipliers[1].real()), WithinAbs(-0.3389565538, 5e-11));
}

TEST_CASE("the Ikeda map is that of a complex number and shrinks areas by B^2", "[models][reference]") {
    const auto system = make_system("ikeda");
    Eigen::VectorXd theta = system->default_parameters();
    theta << 0.8, 0.7, 0.3, 5.0;
    std::complex<double> z(0.4, -1.2);
    const Eigen::Vector2d start(z.real(), z.imag());
    const auto flow = system->flow_with_sensitivities(start, 0.0, std::array{1.0, 3.0}, theta, {}, Clock::time);
    for (int i = 0; i < 3; ++i) {
        z = 0.8 + 0.7 * z * std::exp(std::complex<double>(0.0, 0.3 - 5.0 / (1.0 + std::norm(z))));
        if (i == 0) CHECK(std::abs(z - std::complex<double>(flow.states(0, 0), flow.states(1, 0))) < 1e-15);
    }
    CHECK(std::abs(z - std::complex<double>(flow.states(0, 1), flow.states(1, 1))) < 1e-14);
    CHECK_THAT(flow.sensitivity(0, 2).determinant(), WithinAbs(0.49, 1e-14));
    CHECK_THAT(flow.sensitivity(1, 2).determinant(), WithinAbs(std::pow(0.49, 3), 1e-14));
}

}  // namespace orbid::models::ikeda_test

#include "models/catalogue/van_der_pol.hpp"

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"
#include "tests/models/catalogue/closed_orbit.hpp"
#include "tests/source_folder.hpp"

namespace orbid::models::van_der_pol_test {

static_assert(SymmetricModel<VanDerPol>);

using tests::WithinAbs;
using tests::WithinRel;

namespace {

/// The limit cycle through (amplitude, 0), from a guess of the amplitude and the period.
tests::ClosedOrbit limit_cycle(const System& system, double mu, double amplitude, double period) {
    return tests::closed_orbit(system, Eigen::VectorXd::Constant(1, mu), Eigen::Vector2d(amplitude, 0.0), period, 1);
}

}  // namespace

TEST_CASE("van der Pol's limit cycle at mu = 1 has its known period and amplitude", "[models][reference]") {
    // E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, section II.16, exercise 1:
    // T = 6.6632868593231301896996820305, A = 2.00861986087484313650940188. model_motions.py finds the same and adds
    // the multiplier.
    std::ifstream in(orbid::tests::source_folder() + "/tests/reference/model_motions.json");
    const auto reference = nlohmann::json::parse(in)["van_der_pol"];
    const auto number = [&](const char* key) { return std::stod(reference[key].get<std::string>()); };
    CHECK(number("period") == 6.6632868593231301896996820305);
    CHECK(number("amplitude") == 2.00861986087484313650940188);
    const auto system = make_system("van_der_pol");
    const auto cycle = limit_cycle(*system, 1.0, 2.0, 6.6);
    // Measured 4.2e-13, 6.0e-13 and 8.7e-12, times ten.
    CHECK_THAT(cycle.period, WithinAbs(number("period"), 4.2e-12));
    CHECK_THAT(cycle.start[0], WithinAbs(number("amplitude"), 6e-12));
    CHECK_THAT(cycle.monodromy.trace() - 1.0, WithinAbs(number("multiplier"), 8.7e-11));
}

TEST_CASE("van der Pol's period follows its series in mu", "[models][reference]") {
    // omega = 1 - mu^2/16 + 17 mu^4/3072 + 35 mu^6/884736 - 678899 mu^8/5096079360 + ..., from the method of Lindstedt;
    // C. M. Andersen, J. F. Geer, SIAM Journal on Applied Mathematics 42:678-693 (1982).
    const auto system = make_system("van_der_pol");
    for (const double mu : {0.05, 0.2, 0.3}) {
        CAPTURE(mu);
        const double m2 = mu * mu;
        const double omega =
            1.0 + m2 * (-1.0 / 16.0 + m2 * (17.0 / 3072.0 + m2 * (35.0 / 884736.0 - m2 * 678899.0 / 5096079360.0)));
        // The next coefficient is of the size of the last; 1e-11 is the accuracy of the flow.
        CHECK_THAT(limit_cycle(*system, mu, 2.0, 2.0 * std::numbers::pi / omega).period,
                   WithinAbs(2.0 * std::numbers::pi / omega, 1e-11 + 1e-3 * std::pow(mu, 10)));
    }
}

TEST_CASE("without excitation van der Pol's oscillator is harmonic", "[models][fast]") {
    const auto system = make_system("van_der_pol");
    const auto flow =
        system->flow(Eigen::Vector2d(1.5, -0.4), 0.0, std::array{1.0}, Eigen::VectorXd::Zero(1), Clock::time);
    // A dozen steps with a local error of 1e-12 each.
    CHECK_THAT(flow.states(0, 0), WithinAbs(1.5 * std::cos(1.0) - 0.4 * std::sin(1.0), 1e-11));
    CHECK_THAT(flow.states(1, 0), WithinAbs(-1.5 * std::sin(1.0) - 0.4 * std::cos(1.0), 1e-11));
}

}  // namespace orbid::models::van_der_pol_test

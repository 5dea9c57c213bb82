#include "models/catalogue/parametric_pendulum.hpp"

#include <cmath>

#include "tests/catch.hpp"

namespace orbid::models::parametric_pendulum_test {

namespace {
using Crank = PendulumOn<Support::crank>;
}

TEST_CASE("the support of the pendulum accelerates as the crank height does", "[models][reference]") {
    // Independent of (M2): second difference of A cos wt + L sqrt(1 - e^2 sin^2 wt), e = A / L.
    const double l = 0.317, g = 9.81, A = 0.131, w = 9.09, e = 0.173;
    const Values<double, 9> p{0.0858, l, 0.0, 4.85e-4, 1.9e-4, g, A, w, e};
    const auto c = Crank::reduced(p);
    const auto height = [&](long double phase) {
        const long double s = std::sin(phase);
        return A * std::cos(phase) + A / e * std::sqrt(1.0L - static_cast<long double>(e) * e * s * s);
    };
    const auto printed = PendulumOn<Support::crank_as_printed>::reduced(p);
    double largest_misprint = 0.0;
    for (const double phase : {0.0, 0.3, 1.0, 2.5, 4.0, 6.0}) {
        CAPTURE(phase);
        const long double h = 1e-4L;
        const auto acceleration =
            static_cast<double>((height(phase + h) - 2 * height(phase) + height(phase - h)) / (h * h) * w * w);
        // Truncation h^2 / 12 times the fourth derivative (about A w^2 = 11): 1e-8, divided by l.
        CHECK_THAT(Crank::stiffness(phase, c), tests::WithinAbs((g + acceleration) / l, 1e-7));
        largest_misprint = std::max(
            largest_misprint,
            std::abs(Crank::stiffness(phase, c) - PendulumOn<Support::crank_as_printed>::stiffness(phase, printed)));
    }
    CHECK(largest_misprint > 0.05);
    // Support at its highest: downward acceleration A w^2 (1 + e).
    CHECK_THAT(Crank::stiffness(0.0, c), tests::WithinAbs((g - A * w * w * (1.0 + e)) / l, 1e-12));
    CHECK_THAT(PendulumOn<Support::harmonic>::stiffness(0.0, c), tests::WithinAbs((g - A * w * w) / l, 1e-12));
}

}  // namespace orbid::models::parametric_pendulum_test

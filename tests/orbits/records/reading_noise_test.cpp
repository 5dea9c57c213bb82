// Noise and turns of readings against what made them.
#include <cmath>
#include <limits>
#include <numbers>

#include "estimator/interface/random_stream.hpp"
#include "orbits/records/reading_noise.hpp"
#include "tests/catch.hpp"

namespace reading_noise_test {

using namespace orbid;
using tests::WithinRel;

namespace {

/// 40 turns of 50 samples and a harmonic, with normal errors.
Eigen::VectorXd noisy_turns(double sd) {
    estimator::RandomStream random(3, estimator::RandomPurpose::reading_noise, 0);
    Eigen::VectorXd values(2000);
    for (Eigen::Index k = 0; k < values.size(); ++k) {
        const double t = 2.0 * std::numbers::pi * static_cast<double>(k) / 50.0;
        values[k] = 3.0 + std::sin(t) + 0.3 * std::cos(2.0 * t) + sd * random.normal();
    }
    return values;
}

}  // namespace

TEST_CASE("readings tell the sd of their errors", "[orbits][record]") {
    CHECK_THAT(orbits::reading_noise(noisy_turns(0.01), false), WithinRel(0.01, 0.1));
    CHECK_THAT(orbits::reading_noise(noisy_turns(0.1), false), WithinRel(0.1, 0.1));
    // What a smooth course leaves: its fourth difference, (2 pi / 50)^4 and (4 pi / 50)^4 of the amplitudes.
    CHECK(orbits::reading_noise(noisy_turns(0.0), false) < 3e-4);
    CHECK(orbits::reading_noise(Eigen::VectorXd::Ones(4), false) == 0.0);
}

TEST_CASE("missing readings and turns of an angle are no noise", "[orbits][record]") {
    Eigen::VectorXd angle(1000);
    for (Eigen::Index k = 0; k < angle.size(); ++k)
        angle[k] = std::remainder(0.3 * static_cast<double>(k), 2.0 * std::numbers::pi);
    CHECK(orbits::reading_noise(angle, true) < 1e-12);
    angle[10] = std::numeric_limits<double>::quiet_NaN();
    CHECK(std::isfinite(orbits::reading_noise(angle, true)));
}

TEST_CASE("readings tell the samples of a turn", "[orbits][record]") {
    for (const double sd : {0.0, 0.1})
        CHECK_THAT(orbits::samples_per_turn(noisy_turns(sd)), WithinRel(50.0, 0.01));
    CHECK(orbits::samples_per_turn(Eigen::VectorXd::LinSpaced(70, 0.0, 1.0)) == 70.0);
}

}  // namespace reading_noise_test

#include "models/catalogue/driven_pendulum.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>

#include "models/catalogue/registry.hpp"
#include "models/ensembles/pack_steps.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace orbid::models::driven_pendulum_test {

static_assert(TabulatedModel<DrivenPendulum> && SymmetricModel<DrivenPendulum>);

using tests::WithinAbs;
using tests::WithinRel;

namespace {

constexpr double turn = 2.0 * std::numbers::pi;

struct Cycle {
    Eigen::Vector2d start;
    Eigen::Matrix2d derivative;  ///< over the whole cycle
};

/// The cycle near a start, all its points on the section solved for at once: over whole cycles rounding is stretched by
/// up to 6e3, and the derivative there differs from that of the cycle in the sixth digit.
Cycle cycle_near(const System& system, const Eigen::VectorXd& theta, Eigen::Vector2d x, double phase,
                 Eigen::Index period, double rotation, const FlowOptions& options) {
    const std::array<double, 1> duration{turn};
    Eigen::MatrixXd points(2, period);
    for (Eigen::Index k = 0; k < period; ++k) {
        points.col(k) = x;
        x = system.flow(x, phase, duration, theta, Clock::phase).states.col(0);
    }
    for (int i = 0; i < 6; ++i) {
        Eigen::MatrixXd J = Eigen::MatrixXd::Zero(2 * period, 2 * period);
        Eigen::VectorXd gap(2 * period);
        Eigen::Matrix2d product = Eigen::Matrix2d::Identity();
        for (Eigen::Index k = 0; k < period; ++k) {
            const auto flow =
                system.flow_with_sensitivities(points.col(k), phase, duration, theta, {}, Clock::phase, options);
            const Eigen::Index next = (k + 1) % period;
            gap.segment<2>(2 * k) = points.col(next) - flow.states.col(0);
            if (next == 0) gap[2 * k] += rotation * turn;
            J.block<2, 2>(2 * k, 2 * k) += flow.sensitivities;
            J.block<2, 2>(2 * k, 2 * next) -= Eigen::Matrix2d::Identity();
            product = flow.sensitivities * product;
        }
        if (i == 5) return {points.col(0), product};
        const Eigen::VectorXd correction = J.partialPivLu().solve(gap);
        points += correction.reshaped(2, period);
    }
    return {};
}

}  // namespace

TEST_CASE("the tabulated cycles of the driven pendulum close", "[models][reference]") {
    std::ifstream in(orbid::tests::source_folder() + "/tests/reference/driven_pendulum_orbits.json");
    const auto table = nlohmann::json::parse(in);
    const auto system = make_system("driven_pendulum");
    const Eigen::VectorXd theta = system->default_parameters();
    CHECK(theta == Eigen::Vector3d(table["parameters"]["gamma"], table["parameters"]["A"], 2.0 / 3.0));
    const auto number = [](const nlohmann::json& cycle, const char* key) {
        return std::stod(cycle[key].get<std::string>());
    };
    REQUIRE(table["cycles"].size() == 7);
    // Measured at most 2.3e-11 rad and rad/s, 2.9e-9 of the unstable and of the stable multiplier at tolerance 1e-12,
    // and 2.4e-13, 2.8e-11 and 1.9e-10 at 1e-14, times five and more; the stable ones are printed to ten digits.
    struct Accuracy {
        double tolerance, point, unstable, stable;
    };
    for (const Accuracy& accuracy : {Accuracy{1e-12, 1e-10, 2.9e-8, 2.9e-8}, Accuracy{1e-14, 2.4e-12, 2.8e-10, 1e-9}})
        for (const auto& entry : table["cycles"]) {
            const double period = entry["period"], rotation = entry["rotation"];
            CAPTURE(accuracy.tolerance, period, rotation);
            const Eigen::Vector2d start(number(entry, "theta_0"), number(entry, "theta_dot_0"));
            // The cycle, and its mirror image half a period later with the opposite rotation.
            for (const double sign : {1.0, -1.0}) {
                const double phase = sign > 0.0 ? 0.0 : system->symmetry()->phase_shift;
                const Cycle cycle =
                    cycle_near(*system, theta, sign * start, phase, static_cast<Eigen::Index>(period), sign * rotation,
                               {.relative_tolerance = accuracy.tolerance, .absolute_tolerance = accuracy.tolerance});
                CHECK((cycle.start - sign * start).cwiseAbs().maxCoeff() < accuracy.point);
                // The product of the multipliers is known; the trace then gives both without loss.
                const double determinant = std::exp(-theta[0] * turn * period / theta[2]);
                const double half = 0.5 * cycle.derivative.trace();
                const double unstable = half + std::copysign(std::sqrt(half * half - determinant), half);
                CHECK_THAT(unstable, WithinRel(number(entry, "unstable_multiplier"), accuracy.unstable));
                CHECK_THAT(determinant / unstable, WithinRel(number(entry, "stable_multiplier"), accuracy.stable));
                // Products of entries of the size of the unstable multiplier cancel in the determinant.
                CHECK_THAT(cycle.derivative.determinant(),
                           WithinAbs(determinant, 10.0 * accuracy.tolerance * cycle.derivative.squaredNorm()));
            }
        }
}

TEST_CASE("a driven pendulum without torque and damping keeps its energy", "[models][fast]") {
    const auto system = make_system("driven_pendulum");
    const Eigen::Vector3d theta(0.0, 0.0, 1.0);
    const auto energy = [](const Eigen::Vector2d& x) { return 0.5 * x[1] * x[1] - std::cos(x[0]); };
    const Eigen::Vector2d x0(2.5, 0.3);
    const auto flow = system->flow(x0, 0.0, std::array{20.0}, theta, Clock::time);
    REQUIRE(flow.status == FlowStatus::ok);
    // Some hundred steps with a local error of 1e-12 of the state each.
    CHECK_THAT(energy(flow.states.col(0)), WithinAbs(energy(x0), 1e-10));
}

}  // namespace orbid::models::driven_pendulum_test

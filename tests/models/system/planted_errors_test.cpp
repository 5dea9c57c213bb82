// Errors planted into the derivatives of the catalogue's models, one entry at a time: the check of derivatives finds
// all of them.

#include <cmath>
#include <numbers>
#include <vector>

#include "models/catalogue/double_pendulum.hpp"
#include "models/catalogue/duffing.hpp"
#include "models/catalogue/henon.hpp"
#include "models/catalogue/lorenz.hpp"
#include "models/catalogue/parametric_pendulum.hpp"
#include "models/kernels/model_system.hpp"
#include "models/system/derivative_check.hpp"
#include "tests/catch.hpp"
#include "tests/models/system/planted_error.hpp"

namespace orbid::models::planted_errors_test {

using tests::Part;
using tests::SpoiltFlow;
using tests::SpoiltImpacts;
using tests::SpoiltMap;

namespace {

constexpr double turn = 2.0 * std::numbers::pi;

/// Ball on a floor that swings, with a coefficient of restitution.
struct Bouncing {
    static constexpr std::string_view name = "bouncing";
    static constexpr std::string_view summary = "";
    static constexpr std::string_view equations = "x'' = -g - c x', v+ = -e v- at x = s";
    static constexpr std::array coordinates{real("x", "m"), real("v", "m/s")};
    static constexpr std::array parameters{Parameter{"g", "m/s^2", positive, 9.81, "gravity"},
                                           Parameter{"c", "1/s", nonnegative, 0.2, "drag"},
                                           Parameter{"e", "1", nonnegative, 0.8, "restitution"},
                                           Parameter{"s", "m", any_real, 0.1, "height of the floor"}};
    static constexpr std::size_t surface_count = 1;
    static constexpr std::array<bool, 1> impacts{true};
    static bool smooth(const Values<double, 4>&) { return false; }
    template <class T>
    static State<T, 2> rhs(const T&, const State<T, 2>& x, const Values<T, 4>& p, const std::array<double, 1>&) {
        return {x[1], -p[0] - p[1] * x[1]};
    }
    template <class T>
    static Values<T, 1> surfaces(const T&, const State<T, 2>& x, const Values<T, 4>& p) {
        return {x[0] - p[3]};
    }
    template <class T>
    static State<T, 2> reset(std::size_t, const T&, const State<T, 2>& x, const Values<T, 4>& p) {
        return {x[0], -p[2] * x[1]};
    }
};

struct Flow {
    Eigen::VectorXd x0, theta;
    std::vector<double> durations;
    Clock clock = Clock::time;
};

DerivativeCheck check_of(const System& system, const Flow& flow) {
    std::vector<Eigen::Index> free;
    for (Eigen::Index i = 0; i < flow.theta.size(); ++i)
        free.push_back(i);
    return check_derivatives(system, flow.x0, 0.4, flow.durations, flow.theta, free, flow.clock);
}

/// The sensitivities at the last instant: an entry that changes none of them is not there.
Eigen::MatrixXd sensitivities(const System& system, const Flow& flow) {
    std::vector<Eigen::Index> free;
    for (Eigen::Index i = 0; i < flow.theta.size(); ++i)
        free.push_back(i);
    return system.flow_with_sensitivities(flow.x0, 0.4, flow.durations, flow.theta, free, flow.clock).sensitivities;
}

/// Plants every error of one part of a model, and counts; all must be found.
template <class Spoilt>
std::size_t all_found(Part part, std::size_t outputs, const Flow& flow) {
    const ModelSystem<Spoilt> model;
    const System& system = model;
    Spoilt::error = {};
    const auto right = check_of(system, flow);
    CAPTURE(Spoilt::name, right.message);
    CHECK(right.passed);
    CHECK(right.compared > 0);
    const Eigen::MatrixXd exact = sensitivities(system, flow);
    const std::size_t inputs = dimension_of<Spoilt> + std::tuple_size_v<Constants<Spoilt, double>>;
    std::size_t planted = 0;
    for (std::size_t output = 0; output < outputs; ++output)
        for (std::size_t input = 0; input < inputs; ++input)
            for (const double factor : {0.0, -1.0, 1.01}) {
                Spoilt::error = {part, output, input, factor};
                if (sensitivities(system, flow) == exact) continue;
                ++planted;
                // Events are located by the derivative of their surface: without it, or with its sign turned, there is
                // no flow at all, which every caller is told.
                const bool none =
                    system.flow(flow.x0, 0.4, flow.durations, flow.theta, flow.clock).status != FlowStatus::ok;
                const auto check = check_of(system, flow);
                CAPTURE(output, input, factor, check.message);
                CHECK((none || !check.passed));
            }
    Spoilt::error = {};
    return planted;
}

template <class M>
Flow flow_of(std::initializer_list<double> x0, std::vector<double> durations, Clock clock = Clock::time) {
    Flow flow;
    flow.x0 = Eigen::Map<const Eigen::VectorXd>(x0.begin(), static_cast<Eigen::Index>(x0.size()));
    flow.theta = ModelSystem<M>().default_parameters();
    flow.durations = std::move(durations);
    flow.clock = clock;
    return flow;
}

}  // namespace

TEST_CASE("every error planted into the derivatives of a model is found", "[models][fast]") {
    std::size_t planted = 0;
    planted += all_found<SpoiltFlow<Duffing>>(Part::equations, 2,
                                              flow_of<SpoiltFlow<Duffing>>({0.7, -0.3}, {1.0, turn}, Clock::phase));
    planted +=
        all_found<SpoiltFlow<Lorenz>>(Part::equations, 3, flow_of<SpoiltFlow<Lorenz>>({1.0, 2.0, 20.0}, {0.1, 0.5}));
    planted += all_found<SpoiltMap<Henon>>(Part::equations, 2, flow_of<SpoiltMap<Henon>>({0.3, 0.2}, {1.0, 3.0}));
    using Pendulum = PendulumOn<Support::crank>;
    Flow crank = flow_of<SpoiltFlow<Pendulum>>({1.2, 3.0}, {1.0, turn}, Clock::phase);
    crank.theta[2] = 1e-3;  // dry friction
    planted += all_found<SpoiltFlow<Pendulum>>(Part::equations, 2, crank);
    planted += all_found<SpoiltFlow<ViscousJoints>>(
        Part::equations, 4, flow_of<SpoiltFlow<ViscousJoints>>({0.6, -0.4, 1.0, 2.0}, {0.1, 0.7}));
    CAPTURE(planted);
    CHECK(planted >= 100);
}

TEST_CASE("every error planted into an impact is found", "[models][fast]") {
    const Flow flow = flow_of<SpoiltImpacts<Bouncing>>({1.0, 0.3}, {0.2, 0.7, 1.4});
    std::size_t planted = all_found<SpoiltImpacts<Bouncing>>(Part::equations, 2, flow);
    planted += all_found<SpoiltImpacts<Bouncing>>(Part::reset, 2, flow);
    planted += all_found<SpoiltImpacts<Bouncing>>(Part::surface, 1, flow);
    CAPTURE(planted);
    CHECK(planted >= 20);
}

}  // namespace orbid::models::planted_errors_test

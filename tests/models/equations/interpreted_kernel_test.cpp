#include "models/equations/interpreted_kernel.hpp"

#include <cmath>
#include <numbers>
#include <span>
#include <string>
#include <vector>

#include "models/catalogue/registry.hpp"
#include "models/system/kernel_system.hpp"
#include "tests/catch.hpp"

namespace interpreted_kernel_test {

using namespace orbid;
using models::EquationProblem;
using models::Equations;
using models::EquationText;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

std::shared_ptr<const models::System> interpreted(const EquationText& text) {
    std::vector<EquationProblem> problems;
    const auto equations = Equations::read(text, problems);
    for (const EquationProblem& problem : problems)
        UNSCOPED_INFO(problem.rule);
    REQUIRE(equations);
    std::string why;
    const auto kernel = models::interpreted_kernel(equations, why);
    INFO(why);
    REQUIRE(kernel);
    return std::make_shared<models::KernelSystem>(kernel);
}

/// Parameters of a model of the registry, with its own names and values.
std::vector<EquationText::Parameter> parameters_of(const models::System& system) {
    std::vector<EquationText::Parameter> list;
    for (const models::Parameter& p : system.parameters())
        list.push_back({std::string(p.name), std::string(p.unit), p.domain, p.default_value, p.typical_size});
    return list;
}

EquationText::Quantity quantity(const std::string& name, const std::string& text, bool angle = false) {
    return {name, text, "1", angle};
}

EquationText duffing() {
    EquationText text;
    text.coordinates = {quantity("x", "x_dot"),
                        quantity("x_dot", "gamma * cos(tau) - delta * x_dot - x * (alpha + beta * x * x)")};
    text.parameters = parameters_of(*models::make_system("duffing"));
    text.forcing = {"tau", "omega"};
    return text;
}

EquationText lorenz() {
    EquationText text;
    text.coordinates = {quantity("x", "sigma * (y - x)"), quantity("y", "x * (rho - z) - y"),
                        quantity("z", "x * y - beta * z")};
    text.parameters = parameters_of(*models::make_system("lorenz"));
    return text;
}

EquationText henon() {
    EquationText text;
    text.map = true;
    text.coordinates = {quantity("x", "1 - a * x * x + y"), quantity("y", "b * x")};
    text.parameters = parameters_of(*models::make_system("henon"));
    return text;
}

/// (M1) and (M2), with dry friction.
EquationText pendulum() {
    EquationText text;
    text.coordinates = {
        quantity("phi", "phi_dot", true),
        quantity("phi_dot",
                 "-(k1 * sign(phi_dot) + k2 * phi_dot + k3 * phi_dot * abs(phi_dot)) / (m * l * l) - P * sin(phi)")};
    text.definitions = {
        quantity("s", "sin(tau)"), quantity("root", "1 - epsilon^2 * s^2"),
        quantity("P", "g / l - A * omega^2 / l * (cos(tau) + epsilon * (cos(2 * tau) + epsilon^2 * s^4) / root^1.5)")};
    text.parameters = parameters_of(*models::make_system("parametric_pendulum"));
    text.parameters[2].value = 1e-3;  // k1: friction is on
    text.forcing = {"tau", "omega"};
    return text;
}

struct Case {
    std::string name;
    EquationText text;
    std::shared_ptr<const models::System> system;
    Eigen::VectorXd x0;
    double duration;
};

std::vector<Case> cases() {
    return {
        {"duffing", duffing(), models::make_system("duffing"), Eigen::Vector2d(0.3, -0.2), 20.0},
        {"lorenz", lorenz(), models::make_system("lorenz"), Eigen::Vector3d(1.0, 2.0, 20.0), 3.0},
        {"parametric_pendulum", pendulum(), models::make_system("parametric_pendulum"), Eigen::Vector2d(1.0, 2.0), 3.0},
        {"henon", henon(), models::make_system("henon"), Eigen::Vector2d(0.1, 0.2), 12.0}};
}

Eigen::VectorXd values_of(const Case& each) {
    Eigen::VectorXd theta(static_cast<Eigen::Index>(each.text.parameters.size()));
    for (Eigen::Index i = 0; i < theta.size(); ++i)
        theta[i] = each.text.parameters[static_cast<std::size_t>(i)].value;
    return theta;
}

/// Largest difference over the largest entry.
double difference(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
    REQUIRE(a.rows() == b.rows());
    REQUIRE(a.cols() == b.cols());
    return (a - b).cwiseAbs().maxCoeff() / b.cwiseAbs().maxCoeff();
}

}  // namespace

TEST_CASE("equations as text give the flows of the model they are", "[models][equations]") {
    for (const Case& each : cases()) {
        CAPTURE(each.name);
        const auto system = interpreted(each.text);
        const Eigen::VectorXd theta = values_of(each);
        const std::vector<double> durations{0.5 * each.duration, each.duration};
        const std::vector<Eigen::Index> free{0, 1};
        const auto clock = models::Clock::time;
        const auto mine = system->flow_with_sensitivities(each.x0, 0.3, durations, theta, free, clock);
        const auto theirs = each.system->flow_with_sensitivities(each.x0, 0.3, durations, theta, free, clock);
        REQUIRE(mine.status == models::FlowStatus::ok);
        // Same steps; what is left are roundings of formulas that are written differently, times the growth of errors
        // on the way. Measured: at most 3e-12 (lorenz).
        CHECK(mine.crossings == theirs.crossings);
        CHECK(difference(mine.states, theirs.states) < 3e-11);
        CHECK(difference(mine.sensitivities, theirs.sensitivities) < 3e-11);
        const auto second = system->flow_with_second_derivatives(each.x0, 0.3, durations, theta, free, clock);
        const auto their_second =
            each.system->flow_with_second_derivatives(each.x0, 0.3, durations, theta, free, clock);
        CHECK(difference(second.second_derivatives, their_second.second_derivatives) < 3e-10);
    }
}

TEST_CASE("equations as text give the ensembles of the model they are", "[models][equations]") {
    for (const Case& each : cases()) {
        CAPTURE(each.name);
        if (each.system->kind() == models::Kind::autonomous) continue;
        const auto system = interpreted(each.text);
        const Eigen::VectorXd theta = values_of(each);
        Eigen::MatrixXd starts(2, 40);
        for (Eigen::Index i = 0; i < starts.cols(); ++i)
            starts.col(i) = (0.5 + 0.02 * static_cast<double>(i)) * each.x0;
        const auto mine = system->ensemble(starts, 0.0, 3, theta),
                   theirs = each.system->ensemble(starts, 0.0, 3, theta);
        REQUIRE(mine.sections.size() == theirs.sections.size());
        for (std::size_t i = 0; i < mine.sections.size(); ++i)
            CHECK(difference(mine.sections[i], theirs.sections[i]) < 1e-10);
    }
}

TEST_CASE("equations as text give many flows at once", "[models][equations]") {
    for (const Case& each : cases()) {
        CAPTURE(each.name);
        const auto system = interpreted(each.text);
        const Eigen::VectorXd theta = values_of(each);
        Eigen::MatrixXd starts(each.x0.size(), 30);
        for (Eigen::Index i = 0; i < starts.cols(); ++i)
            starts.col(i) = (0.7 + 0.02 * static_cast<double>(i)) * each.x0;
        const std::vector<double> phases(30, 0.2), durations{each.system->kind() == models::Kind::map ? 2.0 : 0.7};
        std::vector<Eigen::Index> free{0, 1};
        if (theta.size() > 2) free.push_back(static_cast<Eigen::Index>(theta.size()) - 1);
        const auto mine = system->flows(starts, phases, durations, theta, free, models::Clock::time);
        const auto theirs = each.system->flows(starts, phases, durations, theta, free, models::Clock::time);
        for (std::size_t i = 0; i < mine.size(); ++i) {
            CHECK(difference(mine[i].states, theirs[i].states) < 1e-10);
            CHECK(difference(mine[i].sensitivities, theirs[i].sensitivities) < 1e-9);
        }
    }
}

TEST_CASE("sections of equations as text", "[models][equations]") {
    const auto system = interpreted(lorenz());
    const auto lorenz = models::make_system("lorenz");
    const models::Section section{Eigen::Vector3d(0.0, 0.0, 1.0), 27.0, -1};
    const Eigen::Vector3d x0(1.0, 2.0, 20.0);
    const Eigen::VectorXd theta = lorenz->default_parameters();
    const std::vector<Eigen::Index> free{1};
    const auto mine = system->crossings(x0, section, 3, 10.0, theta, free);
    const auto theirs = lorenz->crossings(x0, section, 3, 10.0, theta, free);
    CHECK(difference(mine.states, theirs.states) < 1e-10);
    CHECK(difference(mine.sensitivities, theirs.sensitivities) < 1e-9);
}

TEST_CASE("dry friction without a forcing, and with inputs, as text", "[models][equations]") {
    EquationText text;
    text.coordinates = {quantity("phi", "w", true),
                        quantity("w", "-w0sq * sin(phi) - c1 * sign(w) - c2 * w - c3 * w * abs(w)")};
    const auto pendulum = models::make_system("free_pendulum");
    text.parameters = parameters_of(*pendulum);
    text.parameters.pop_back();      // the offset belongs to the instrument
    text.parameters[1].value = 0.4;  // c1
    const auto system = interpreted(text);
    Eigen::VectorXd theta(4), all(5);
    theta << 30.0, 0.4, 0.05, 0.01;
    all << theta, 0.0;
    CHECK_FALSE(system->smooth(theta));
    CHECK(system->smooth(Eigen::Vector4d(30.0, 0.0, 0.05, 0.01)));
    CHECK(system->at_rest(Eigen::Vector2d(0.001, 0.0), theta));
    CHECK_FALSE(system->at_rest(Eigen::Vector2d(0.1, 0.0), theta));
    // Swings three times and stops for good.
    const std::vector<double> durations{0.5, 20.0};
    const std::vector<Eigen::Index> free{0, 1, 2};
    const Eigen::Vector2d x0(0.3, 0.0);
    const auto mine = system->flow_with_sensitivities(x0, 0.0, durations, theta, free, models::Clock::time);
    const auto theirs = pendulum->flow_with_sensitivities(x0, 0.0, durations, all, free, models::Clock::time);
    CHECK(mine.stickings == 1);
    CHECK(mine.crossings == theirs.crossings);
    CHECK(difference(mine.states, theirs.states) < 1e-12);
    CHECK(difference(mine.sensitivities, theirs.sensitivities) < 1e-11);

    const auto strut = models::make_system("landing_gear_damper", "measured_base");
    text.coordinates = {quantity("stroke", "v"),
                        quantity("v",
                                 "g + a - p0 * area / m * (V0 / (V0 - area * stroke))^kappa - ((c_compression + "
                                 "c_rebound) / 2 * sign(v) + (c_compression - c_rebound) / 2) / m * v^2 - friction / m "
                                 "* sign(v)")};
    text.parameters = parameters_of(*strut);
    text.inputs = {{"a", "", "m/s^2", false}};
    const std::vector<double> times{0.0, 0.3, 0.5, 2.0}, values{0.0, 4.0, -3.0, 0.0};
    const auto signal =
        std::make_shared<models::InputSignal>(times, values, 1, models::InputSignal::Interpolation::cubic);
    const auto mine_on = interpreted(text)->with_input(signal), theirs_on = strut->with_input(signal);
    const std::vector<double> until{1.5};
    const Eigen::Vector2d start(0.1, 0.2);
    const auto one =
        mine_on->flow_with_sensitivities(start, 0.0, until, strut->default_parameters(), free, models::Clock::time);
    const auto other =
        theirs_on->flow_with_sensitivities(start, 0.0, until, strut->default_parameters(), free, models::Clock::time);
    REQUIRE(one.status == models::FlowStatus::ok);
    CHECK(difference(one.states, other.states) < 1e-11);
    CHECK(difference(one.sensitivities, other.sensitivities) < 1e-10);
}

TEST_CASE("a surface that is no velocity is passed and slid along as a general one", "[models][equations]") {
    // The same oscillator, its velocity first: its surface is then a general one, whose sliding is sticking.
    EquationText friction;
    friction.coordinates = {quantity("x", "v"), quantity("v", "b * cos(phase) - w2 * x - c * sign(v)")};
    friction.parameters = {{"w2", "1", models::positive, 4.0},
                           {"c", "1", models::nonnegative, 0.5},
                           {"b", "1", models::any_real, 0.9},
                           {"omega", "1", models::positive, 1.5}};
    friction.forcing = {"phase", "omega"};
    EquationText surface = friction;
    std::swap(surface.coordinates[0], surface.coordinates[1]);
    const auto one = interpreted(friction), other = interpreted(surface);
    const Eigen::VectorXd theta = one->default_parameters();
    const std::vector<double> durations{3.0, 9.0};
    const std::vector<Eigen::Index> free{0, 1, 3};
    const auto a =
        one->flow_with_sensitivities(Eigen::Vector2d(1.0, 0.5), 0.2, durations, theta, free, models::Clock::time);
    const auto b =
        other->flow_with_sensitivities(Eigen::Vector2d(0.5, 1.0), 0.2, durations, theta, free, models::Clock::time);
    REQUIRE(b.status == models::FlowStatus::ok);
    CHECK(a.stickings > 0);
    CHECK(difference(b.states.colwise().reverse(), a.states) < 1e-10);
    const auto b_sensitivities = b.sensitivities.colwise().reverse().eval();
    // Directions of the start are swapped too.
    for (const Eigen::Index k : {0, 5}) {
        CHECK((b_sensitivities.col(k) - a.sensitivities.col(k + 1)).norm() < 1e-8);
        CHECK((b_sensitivities.col(k + 1) - a.sensitivities.col(k)).norm() < 1e-8);
        for (Eigen::Index j = 2; j < 5; ++j)
            CHECK((b_sensitivities.col(k + j) - a.sensitivities.col(k + j)).norm() < 1e-8);
    }
    CHECK_FALSE(other->smooth(theta));
}

TEST_CASE("models with fewer coordinates than a shape, and with many", "[models][equations]") {
    EquationText logistic;
    logistic.map = true;
    logistic.coordinates = {quantity("x", "r * x * (1 - x)")};
    logistic.parameters = parameters_of(*models::make_system("logistic"));
    const auto map = interpreted(logistic), registered_map = models::make_system("logistic");
    const Eigen::VectorXd r = registered_map->default_parameters();
    const std::vector<double> iterations{1.0, 5.0};
    const std::vector<Eigen::Index> first{0};
    const Eigen::VectorXd x0 = Eigen::VectorXd::Constant(1, 0.3);
    const auto mine = map->flow_with_second_derivatives(x0, 0.0, iterations, r, first, models::Clock::time);
    const auto theirs =
        registered_map->flow_with_second_derivatives(x0, 0.0, iterations, r, first, models::Clock::time);
    CHECK(difference(mine.states, theirs.states) < 1e-13);
    CHECK(difference(mine.sensitivities, theirs.sensitivities) < 1e-13);
    CHECK(difference(mine.second_derivatives, theirs.second_derivatives) < 1e-13);
    Eigen::MatrixXd starts = Eigen::RowVectorXd::LinSpaced(70, 0.1, 0.9);
    const auto ensemble = map->ensemble(starts, 0.0, 6, r), reference = registered_map->ensemble(starts, 0.0, 6, r);
    for (std::size_t i = 0; i < ensemble.sections.size(); ++i)
        CHECK(difference(ensemble.sections[i], reference.sections[i]) < 1e-12);

    EquationText ring;
    const int n = 6;
    for (int i = 0; i < n; ++i) {
        const auto x = [&](int k) { return "x" + std::to_string((i + k + n) % n + 1); };
        ring.coordinates.push_back(quantity(x(0), "(" + x(1) + " - " + x(-2) + ") * " + x(-1) + " - " + x(0) + " + F"));
    }
    ring.parameters = parameters_of(*models::make_system("lorenz96"));
    const auto large = interpreted(ring), lorenz96 = models::make_system("lorenz96", "", n);
    Eigen::VectorXd start(n);
    start << 8.0, 8.1, 7.0, 8.0, 6.5, 8.0;
    const auto a = large->flow_with_sensitivities(start, 0.0, std::vector<double>{1.0}, lorenz96->default_parameters(),
                                                  first, models::Clock::time);
    const auto b = lorenz96->flow_with_sensitivities(start, 0.0, std::vector<double>{1.0},
                                                     lorenz96->default_parameters(), first, models::Clock::time);
    CHECK(difference(a.states, b.states) < 1e-12);
    CHECK(difference(a.sensitivities, b.sensitivities) < 1e-12);

    // A forced oscillator with a filtered reading: three coordinates in a shape of four.
    EquationText filtered = duffing();
    filtered.coordinates.push_back(quantity("y", "4 * (x - y)"));
    const auto three = interpreted(filtered), two = models::make_system("duffing");
    const Eigen::VectorXd theta = two->default_parameters();
    const std::vector<Eigen::Index> free{1, 4};
    const auto c = three->flow_with_sensitivities(Eigen::Vector3d(0.3, -0.2, 0.0), 0.1, std::vector<double>{5.0}, theta,
                                                  free, models::Clock::phase);
    const auto d = two->flow_with_sensitivities(Eigen::Vector2d(0.3, -0.2), 0.1, std::vector<double>{5.0}, theta, free,
                                                models::Clock::phase);
    CHECK(difference(c.states.topRows(2), d.states) < 1e-11);
    CHECK(difference(c.sensitivities.topRows(2)(Eigen::all, std::vector<int>{0, 1, 3, 4}), d.sensitivities) < 1e-9);
}

}  // namespace interpreted_kernel_test

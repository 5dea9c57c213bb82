#include "models/equations/equations.hpp"

#include <cmath>
#include <string>
#include <vector>

#include "models/equations/equation_source.hpp"
#include "models/equations/staged_equations.hpp"
#include "tests/catch.hpp"

namespace equations_test {

using namespace orbid;
using models::EquationProblem;
using models::Equations;
using models::EquationText;
using models::ExpressionGraph;
using tests::ContainsSubstring;
using Operation = ExpressionGraph::Operation;
using Part = EquationProblem::Part;

namespace {

/// A forced oscillator with dry friction; every test changes something of it.
EquationText oscillator() {
    EquationText text;
    text.coordinates = {{"x", "v", "m", false}, {"v", "b * cos(tau) - k * x - c * sign(v)", "m/s", false}};
    text.parameters = {{"k", "1", models::positive, 4.0},
                       {"c", "1", models::nonnegative, 0.5},
                       {"b", "1", models::any_real, 0.9},
                       {"omega", "1", models::positive, 1.5}};
    text.forcing = {"tau", "omega"};
    return text;
}

std::vector<EquationProblem> problems_of(const EquationText& text) {
    std::vector<EquationProblem> problems;
    const auto equations = Equations::read(text, problems);
    CHECK((equations == nullptr) == !problems.empty());
    return problems;
}

void check_only(const EquationText& text, Part part, std::size_t index, const std::string& rule) {
    const auto problems = problems_of(text);
    CAPTURE(rule);
    REQUIRE(problems.size() == 1);
    CHECK(problems[0].part == part);
    CHECK(problems[0].index == index);
    CHECK_THAT(problems[0].rule, ContainsSubstring(rule));
}

std::shared_ptr<const Equations> read(const EquationText& text) {
    std::vector<EquationProblem> problems;
    auto equations = Equations::read(text, problems);
    for (const auto& problem : problems)
        UNSCOPED_INFO(problem.rule);
    REQUIRE(equations);
    return equations;
}

}  // namespace

TEST_CASE("a graph folds numbers, shares parts and multiplies powers out", "[models][equations]") {
    ExpressionGraph graph;
    const std::vector<std::string> names{"x", "y"};
    const std::vector<ExpressionGraph::Node> nodes{graph.variable(Operation::coordinate, 0),
                                                   graph.variable(Operation::coordinate, 1)};
    const auto node = [&](const std::string& text) {
        return graph.insert(models::Expression::parse(text, names), nodes);
    };
    CHECK(graph[node("2 * 3 + 4^0.5")].value == 8.0);
    CHECK(node("x * y + 1") == node("1 + y * x"));
    CHECK(node("x^2") == node("x * x"));
    CHECK(node("x^3") == node("x * x * x"));
    CHECK(node("x^1.5") == node("x * sqrt(x)"));
    CHECK(node("x^-2") == node("1 / (x * x)"));
    CHECK(node("x - -y") == node("x + y"));
    CHECK(node("1 * x + 0") == node("x"));
    CHECK(graph[node("x^y")].operation == Operation::power);
    CHECK(node("sign(-x)") == node("-sign(x)"));
    // Products with 0 may be nan and stay.
    CHECK(graph[node("0 * x")].operation == Operation::multiply);
}

TEST_CASE("derivatives of a graph are those of its formula", "[models][equations]") {
    const std::vector<std::string> names{"x", "y"};
    for (const char* text :
         {"x * y + x / y - y", "sin(x) * cos(y)", "tan(x * y)", "exp(-x^2) * log(y)", "sqrt(x + y)", "x^y",
          "y^2.5 / x^3", "abs(x - y)", "asin(x / 3) + acos(x / 4) + atan(y)", "sinh(x) - cosh(y) * tanh(x)", "2^x"}) {
        CAPTURE(text);
        const auto expression = models::Expression::parse(text, names);
        ExpressionGraph graph;
        const std::vector<ExpressionGraph::Node> nodes{graph.variable(Operation::coordinate, 0),
                                                       graph.variable(Operation::coordinate, 1)};
        const auto node = graph.insert(expression, nodes);
        const Eigen::Vector2d at(0.7, 1.3);
        const Eigen::VectorXd gradient = expression.gradient(at);
        for (std::size_t j = 0; j < 2; ++j) {
            const auto derivative = graph.derivative(node, nodes[j]);
            const double value =
                derivative
                    ? graph.values(std::span(&*derivative, 1),
                                   [&](const auto& entry) { return at[static_cast<Eigen::Index>(entry.index)]; })[0]
                    : 0.0;
            // A few roundings of numbers of size 1.
            CHECK_THAT(value, tests::WithinAbs(gradient[static_cast<Eigen::Index>(j)], 5e-15));
        }
    }
}

TEST_CASE("what depends on parameters, or on the phase alone, is computed apart", "[models][equations]") {
    const auto stages = models::staged(*read(oscillator()), 40, true);
    // b cos(tau) is the forcing; k, c and b are the constants.
    CHECK(stages.constants.size() == 3);
    REQUIRE(stages.forcing);
    CHECK(stages.graph[*stages.forcing].operation == Operation::multiply);
    EquationText two = oscillator();
    two.coordinates[1].text = "b * cos(tau) + sin(tau) * x - k / b^2 * x - c * sign(v)";
    const auto apart = models::staged(*read(two), 40, true);
    CHECK_FALSE(apart.forcing);                                        // the phase enters twice
    CHECK(apart.constants.size() == 3);                                // b, k / b^2, c
    CHECK(models::staged(*read(two), 2, true).constants.size() == 3);  // the parameters themselves
}

TEST_CASE("sign and abs become sides of switching surfaces", "[models][equations]") {
    const auto friction = read(oscillator());
    CHECK(friction->dry_friction());
    CHECK(friction->surfaces().size() == 1);
    CHECK(friction->kind() == models::Kind::forced);
    const std::vector<double> rough{4.0, 0.5, 0.9, 1.5}, smooth{4.0, 0.0, 0.9, 1.5};
    CHECK_FALSE(friction->smooth(rough.data()));
    CHECK(friction->smooth(smooth.data()));

    // Friction that drives is no friction: a general surface, which is left on both sides.
    EquationText driving = oscillator();
    driving.coordinates[1].text = "b * cos(tau) - k * x + c * sign(v)";
    CHECK_FALSE(read(driving)->dry_friction());
    EquationText stop = oscillator();
    stop.coordinates[1].text = "b * cos(tau) - v - k * (x - c) * (1 + sign(x - c)) / 2";
    const auto contact = read(stop);
    CHECK_FALSE(contact->dry_friction());
    CHECK(contact->surfaces().size() == 1);
    CHECK(contact->smooth(rough.data()));  // a kink, no jump

    // An empty list: abs is computed as it stands.
    EquationText kink = oscillator();
    kink.coordinates[1].text = "b * cos(tau) - k * x - c * v * abs(v)";
    CHECK(read(kink)->surfaces().size() == 1);
    kink.switching.emplace();
    CHECK(read(kink)->surfaces().empty());
    // A sign that parameters decide is a number; so is one in a map.
    EquationText number = oscillator();
    number.coordinates[1].text = "b * cos(tau) - k * x - c * sign(k - 3) * v";
    CHECK(read(number)->surfaces().empty());
}

TEST_CASE("models as text are refused with part, place and rule", "[models][equations]") {
    const auto with = [](auto change) {
        EquationText text = oscillator();
        change(text);
        return text;
    };
    check_only(with([](auto& t) { t.coordinates[1].text = "b * cos(tau) - k * x - c * sign(w)"; }), Part::coordinate, 1,
               "unknown name \"w\"");
    CHECK(problems_of(with([](auto& t) { t.coordinates[1].text = "b * cos(tau) - k x - c * sign(v)"; }))[0].position ==
          17);
    check_only(with([](auto& t) { t.coordinates[0].text = "v + 0 * t"; }), Part::coordinate, 0,
               "time enters as the phase");
    check_only(with([](auto& t) {
                   t.definitions = {{"sin", "x", "1", false}};
               }),
               Part::definition, 0, "a word of the formulas");
    check_only(with([](auto& t) {
                   t.parameters.push_back({"x", "1", models::any_real, 1.0});
               }),
               Part::parameter, 4, "is a coordinate already");
    check_only(with([](auto& t) {
                   t.parameters.push_back({"d", "1", models::any_real, 1.0});
               }),
               Part::parameter, 4, "occurs in no formula");
    check_only(with([](auto& t) { t.parameters[0].value = -1.0; }), Part::parameter, 0, "k must be > 0, not -1");
    check_only(with([](auto& t) { t.forcing->frequency = "Omega"; }), Part::forcing, 0, "is no parameter");
    check_only(with([](auto& t) { t.coordinates[1].text = "b - k * x - c * sign(v)"; }), Part::forcing, 0,
               "occurs in no formula");
    check_only(with([](auto& t) { t.switching = {"x"}; }), Part::switching, 0, "has this argument");
    check_only(with([](auto& t) { t.switching.emplace(); }), Part::model, 0, "does not list");
    check_only(with([](auto& t) { t.stiff = true; }), Part::model, 0, "a stiff model must be smooth");
    check_only(with([](auto& t) { t.inputs = {{"u", "", "V", false}}; }), Part::forcing, 0, "no measured inputs");
    check_only(with([](auto& t) { t.coordinates[1].text += " + 1 / 0"; }), Part::coordinate, 1, "no finite value");
    check_only(with([](auto& t) { t.symmetry = {{-1.0, -1.0}, 0.0}; }), Part::symmetry, 0, "no such symmetry");
    CHECK(problems_of(with([](auto& t) { t.symmetry = {{-1.0, -1.0}, std::acos(-1.0)}; })).empty());
    check_only(with([](auto& t) { t.definitions = {{"s", "sin(x", "1", false}}; }), Part::definition, 0, "\")\"");
    // Several at once.
    CHECK(problems_of(with([](auto& t) {
              t.coordinates[0].text = "v +";
              t.coordinates[1].text = "q";
              t.parameters[0].name = "1k";
          })).size() == 3);
}

TEST_CASE("hostile formulas are refused", "[models][equations]") {
    EquationText text = oscillator();
    text.coordinates[1].text = std::string(5000, '(') + "x" + std::string(5000, ')');
    check_only(text, Part::coordinate, 1, "nested too deeply");
    text.coordinates[1].text = std::string(30000, '-') + "x";
    check_only(text, Part::coordinate, 1, "30001 characters");
    // Doubling in each of eighty definitions: a tree of 2^80 leaves, but a graph of eighty nodes.
    text = oscillator();
    std::string last = "x";
    for (int i = 0; i < 80; ++i) {
        text.definitions.push_back({"d" + std::to_string(i), "sin(" + last + ") + " + last + " * " + last, "1", false});
        last = text.definitions.back().name;
    }
    text.coordinates[1].text += " + " + last;
    CHECK(problems_of(text).empty());
    // More parts than are read.
    text = oscillator();
    for (int i = 0; i < 60; ++i) {
        std::string sum = "x";
        for (int j = 0; j < 100; ++j)
            sum += " + sin(x + " + std::to_string(100 * i + j) + ")";
        text.definitions.push_back({"e" + std::to_string(i), sum, "1", false});
        text.coordinates[1].text += " + e" + std::to_string(i);
    }
    const auto problems = problems_of(text);
    REQUIRE(problems.size() == 1);
    CHECK_THAT(problems[0].rule, ContainsSubstring("at most 5000"));
}

TEST_CASE("the source of a model holds nothing of its text but numbers", "[models][equations]") {
    EquationText text = oscillator();
    std::string why;
    const auto source = models::equation_source(*read(text), why);
    REQUIRE(source);
    text.name = "other_name";
    text.coordinates[0].name = "displacement_of_it";
    text.coordinates[1].text = "b * cos(angle_of_it) - k * displacement_of_it - c * sign(v)";
    text.forcing->phase = "angle_of_it";
    text.parameters[0].description = "\"; } #include </etc/passwd>";
    const auto other = models::equation_source(*read(text), why);
    CHECK(source == other);
    CHECK(source->find("passwd") == std::string::npos);
    CHECK(source->find("of_it") == std::string::npos);
    text.coordinates[1].text = "0.1 + b * cos(angle_of_it) - k * displacement_of_it - c * sign(v)";
    CHECK(models::equation_source(*read(text), why)->find("0x1.999999999999ap-4") != std::string::npos);
}

}  // namespace equations_test

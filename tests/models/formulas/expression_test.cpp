#include "models/formulas/expression.hpp"

#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "models/arithmetic/dual.hpp"
#include "tests/catch.hpp"

namespace expression_test {

using namespace orbid;
using models::Expression;
using models::ExpressionError;
using tests::ContainsSubstring;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

const std::vector<std::string> names{"a", "b", "k2", "m"};

double value(const std::string& text) {
    Eigen::VectorXd values(4);
    values << 3.0, -2.0, 0.5, 0.25;
    return Expression::parse(text, names).value(values);
}

struct Refused {
    std::size_t position;
    std::string message;
};
Refused refusal(const std::string& text) {
    try {
        (void)Expression::parse(text, names);
    } catch (const ExpressionError& error) {
        return {error.position, error.what()};
    }
    return {std::numeric_limits<std::size_t>::max(), "accepted"};
}

}  // namespace

TEST_CASE("operators bind and group as in print", "[models][expression]") {
    // Whole and dyadic numbers: every operation is exact.
    CHECK(value("1 + 2 * 3") == 7.0);
    CHECK(value("(1 + 2) * 3") == 9.0);
    CHECK(value("10 - 4 - 3") == 3.0);
    CHECK(value("32 / 4 / 2") == 4.0);
    CHECK(value("2^3^2") == 512.0);
    CHECK(value("-2^2") == -4.0);
    CHECK(value("(-2)^2") == 4.0);
    CHECK(value("2^-1") == 0.5);
    CHECK(value("2 * -3") == -6.0);
    CHECK(value("- - 2") == 2.0);
    CHECK(value("+2") == 2.0);
    CHECK(value("1.5e2 + .5") == 150.5);
    CHECK(value("k2 / m") == 2.0);
    CHECK(value("a - b * a^2") == 21.0);
    CHECK(value("  a\t*b ") == -6.0);
}

TEST_CASE("functions have their values", "[models][expression]") {
    CHECK(value("sin(0)") == 0.0);
    CHECK(value("cos(0)") == 1.0);
    CHECK(value("exp(0)") == 1.0);
    CHECK(value("log(1)") == 0.0);
    CHECK(value("sqrt(a + 1)") == 2.0);
    CHECK(value("abs(b)") == 2.0);
    CHECK(value("sign(b)") == -1.0);
    CHECK(value("sign(a)") == 1.0);
    CHECK(value("sign(0)") == 0.0);
    CHECK(value("pi") == std::numbers::pi);
    // Rounding of pi / 4 times the slope 2 of tan there.
    CHECK_THAT(value("tan(pi / 4)"), WithinAbs(1.0, 4e-16));
}

TEST_CASE("a formula without a value there is nan or infinite", "[models][expression]") {
    CHECK(std::isnan(value("log(b)")));
    CHECK(std::isnan(value("sqrt(b)")));
    CHECK(std::isinf(value("1 / (a - 3)")));
}

TEST_CASE("gradient is exact", "[models][expression]") {
    Eigen::VectorXd at(4);
    at << 3.0, -2.0, 0.5, 0.25;
    SECTION("quotient") {
        const auto gradient = Expression::parse("k2 / m", names).gradient(at);
        CHECK(gradient == Eigen::Vector4d(0.0, 0.0, 4.0, -8.0));  // 1/m, -k2/m^2
    }
    SECTION("powers of negative numbers") {
        const auto gradient = Expression::parse("b^3 * a^2", names).gradient(at);
        CHECK(gradient == Eigen::Vector4d(-48.0, 108.0, 0.0, 0.0));  // 2 a b^3, 3 a^2 b^2
    }
    SECTION("every function, against its derivative on paper") {
        const double a = 3.0;
        const double b = -2.0;
        const std::vector<std::pair<std::string, double>> by_a{{"sin(a)", std::cos(a)},
                                                               {"cos(a)", -std::sin(a)},
                                                               {"tan(a)", 1.0 / (std::cos(a) * std::cos(a))},
                                                               {"exp(a * b)", b * std::exp(a * b)},
                                                               {"log(a)", 1.0 / a},
                                                               {"sqrt(a)", 0.5 / std::sqrt(a)},
                                                               {"abs(b * a)", -b},
                                                               {"sign(a)", 0.0},
                                                               {"a^a", std::pow(a, a) * (std::log(a) + 1.0)},
                                                               {"2^a", 8.0 * std::numbers::ln2},
                                                               {"a^-2", -2.0 / 27.0}};
        for (const auto& [text, expected] : by_a) {
            CAPTURE(text);
            // A few roundings of numbers of this size.
            CHECK_THAT(Expression::parse(text, names).gradient(at)[0], WithinRel(expected, 1e-15));
        }
    }
}

TEST_CASE("evaluates on dual numbers with the value of plain numbers", "[models][expression]") {
    const auto expression = Expression::parse("sin(a) * exp(k2) / (m + a^b)", names);
    const std::vector<double> plain{3.0, -2.0, 0.5, 0.25};
    std::vector<models::Dual<2>> dual(plain.begin(), plain.end());
    dual[0] = models::Dual<2>::variable(3.0, 0);
    dual[3] = models::Dual<2>::variable(0.25, 1);
    const auto result = expression.evaluate(std::span<const models::Dual<2>>(dual));
    CHECK(result.value == expression.evaluate(std::span<const double>(plain)));
    const Eigen::VectorXd gradient = expression.gradient(Eigen::Map<const Eigen::VectorXd>(plain.data(), 4));
    CHECK(result.partial[0] == gradient[0]);
    CHECK(result.partial[1] == gradient[3]);
}

TEST_CASE("knows which names it uses", "[models][expression]") {
    CHECK(Expression::parse("m * a / m", names).used() == std::vector<std::size_t>{0, 3});
    CHECK(Expression::parse("2 * pi", names).used().empty());
    CHECK(Expression::parse(" k2/m ", names).text() == " k2/m ");
}

TEST_CASE("refuses what is no formula, with the place", "[models][expression]") {
    const auto check = [](const std::string& text, std::size_t position, const std::string& part) {
        CAPTURE(text);
        const Refused refused = refusal(text);
        CHECK(refused.position == position);
        CHECK_THAT(refused.message, ContainsSubstring(part));
    };
    check("", 0, "expected a number, a name or \"(\", found the end");
    check("k2 /", 4, "found the end");
    check("k2 k3", 3, "expected an operator (a product is written with *), found \"k\"");
    check("k2 / q", 5, "unknown name \"q\"");
    check("(a + b", 6, "the \")\" of character 1");
    check("a + b)", 5, "expected an operator or the end");
    check("sin a", 4, "expected \"(\" after sin");
    check("2 * * 3", 4, "found \"*\"");
    check("a ** b", 3, "found \"*\"");
    check("1e999", 0, "out of range");
    check("2a", 1, "expected an operator");
    check("a = b", 2, "found \"=\"");
    check(".", 0, "expected a number");
    check("nan", 0, "unknown name \"nan\"");
    CHECK_THAT(refusal(std::string(1000, '(')).message, ContainsSubstring("nested too deeply"));
    CHECK_THAT(refusal(std::string(1000, '-') + "1").message, ContainsSubstring("nested too deeply"));
}

}  // namespace expression_test

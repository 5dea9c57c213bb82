#include "models/arithmetic/dual.hpp"

#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "tests/catch.hpp"

namespace orbid::models::dual_test {

using tests::WithinAbs;

namespace {

using D = Dual<3>;
using Second = Dual<1, Dual<2>>;

struct Function {
    std::string name;
    std::function<double(double)> plain;
    std::function<D(D)> dual;
    double at;
    double derivative;  // closed form
};

}  // namespace

TEST_CASE("a dual number carries the derivative of every elementary function", "[models][fast]") {
    const std::vector<Function> functions{
        {"sin", [](double x) { return std::sin(x); }, [](D x) { return sin(x); }, 0.7, std::cos(0.7)},
        {"cos", [](double x) { return std::cos(x); }, [](D x) { return cos(x); }, 0.7, -std::sin(0.7)},
        {"tan", [](double x) { return std::tan(x); }, [](D x) { return tan(x); }, 0.7, std::pow(std::cos(0.7), -2)},
        {"asin", [](double x) { return std::asin(x); }, [](D x) { return asin(x); }, 0.6, 1.25},
        {"acos", [](double x) { return std::acos(x); }, [](D x) { return acos(x); }, 0.6, -1.25},
        {"atan", [](double x) { return std::atan(x); }, [](D x) { return atan(x); }, 2.0, 0.2},
        {"sinh", [](double x) { return std::sinh(x); }, [](D x) { return sinh(x); }, 0.7, std::cosh(0.7)},
        {"cosh", [](double x) { return std::cosh(x); }, [](D x) { return cosh(x); }, 0.7, std::sinh(0.7)},
        {"tanh", [](double x) { return std::tanh(x); }, [](D x) { return tanh(x); }, 0.7, std::pow(std::cosh(0.7), -2)},
        {"exp", [](double x) { return std::exp(x); }, [](D x) { return exp(x); }, 0.7, std::exp(0.7)},
        {"log", [](double x) { return std::log(x); }, [](D x) { return log(x); }, 0.7, 1.0 / 0.7},
        {"sqrt", [](double x) { return std::sqrt(x); }, [](D x) { return sqrt(x); }, 0.49, 0.5 / 0.7},
        {"abs", [](double x) { return std::abs(x); }, [](D x) { return abs(x); }, -0.7, -1.0},
        {"pow 3.5", [](double x) { return std::pow(x, 3.5); }, [](D x) { return pow(x, 3.5); }, 0.7,
         3.5 * std::pow(0.7, 2.5)},
        {"x^x", [](double x) { return std::pow(x, x); }, [](D x) { return pow(x, x); }, 0.7,
         std::pow(0.7, 0.7) * (1.0 + std::log(0.7))},
        {"atan2(x, 2)", [](double x) { return std::atan2(x, 2.0); }, [](D x) { return atan2(x, D(2.0)); }, 1.0, 0.4},
        {"x / (1 - x)", [](double x) { return x / (1.0 - x); }, [](D x) { return x / (1.0 - x); }, 0.7, 1.0 / 0.09},
        {"2 / x - x / 3", [](double x) { return 2.0 / x - x / 3.0; }, [](D x) { return 2.0 / x - x / 3.0; }, 0.7,
         -2.0 / 0.49 - 1.0 / 3.0},
        {"(x + x) * x - 5", [](double x) { return (x + x) * x - 5.0; }, [](D x) { return (x + x) * x - 5.0; }, 0.7,
         2.8}};
    for (const Function& f : functions) {
        CAPTURE(f.name);
        const D y = f.dual(D::variable(f.at, 1));
        CHECK(y.value == f.plain(f.at));
        // A few roundings of numbers of size one to eleven.
        CHECK_THAT(y.partial[1], WithinAbs(f.derivative, 1e-14 * (1.0 + std::abs(f.derivative))));
        CHECK(y.partial[0] == 0.0);
        CHECK(y.partial[2] == 0.0);
    }
}

TEST_CASE("several directions obey the product and quotient rule", "[models][fast]") {
    const D x = D::variable(3.0, 0), y = D::variable(-2.0, 2);
    const D product = x * y, quotient = x / y;
    CHECK(product.partial == std::array{-2.0, 0.0, 3.0});
    CHECK(quotient.value == -1.5);
    CHECK(quotient.partial == std::array{-0.5, 0.0, -0.75});
    CHECK(pow(D::variable(-2.0, 0), D(3.0)).partial[0] == 12.0);  // constant exponent, negative base
    CHECK(pow(D::variable(0.0, 0), 0.0).partial[0] == 0.0);
    D sum = x;
    sum += y;
    sum -= 1.0;
    sum *= x;
    sum /= y;
    CHECK(sum.value == 0.0);
    CHECK(sum.partial == std::array{-1.5, 0.0, -1.5});
}

TEST_CASE("nested dual numbers carry second derivatives", "[models][fast]") {
    // f(x y) with x = 0.6 + e, y = 1.1: d/dx = f' y, d2/dx2 = f'' y^2, d2/dx dy = f' + f'' x y. First and second
    // derivatives of each f at 0.66 on paper.
    struct Row {
        std::string name;
        std::function<Second(Second)> f;
        double first, second;
    };
    const double a = 0.66, s = std::sin(a), c = std::cos(a), t = s / c, e = std::exp(a);
    const double sh = std::sinh(a), ch = std::cosh(a), th = sh / ch, q = 1.0 - a * a, ln = std::log(a);
    const std::vector<Row> rows{
        {"sin", [](Second x) { return sin(x); }, c, -s},
        {"cos", [](Second x) { return cos(x); }, -s, -c},
        {"tan", [](Second x) { return tan(x); }, 1.0 + t * t, 2.0 * t * (1.0 + t * t)},
        {"asin", [](Second x) { return asin(x); }, 1.0 / std::sqrt(q), a / (q * std::sqrt(q))},
        {"acos", [](Second x) { return acos(x); }, -1.0 / std::sqrt(q), -a / (q * std::sqrt(q))},
        {"atan", [](Second x) { return atan(x); }, 1.0 / (1.0 + a * a), -2.0 * a / ((1.0 + a * a) * (1.0 + a * a))},
        {"sinh", [](Second x) { return sinh(x); }, ch, sh},
        {"cosh", [](Second x) { return cosh(x); }, sh, ch},
        {"tanh", [](Second x) { return tanh(x); }, 1.0 - th * th, -2.0 * th * (1.0 - th * th)},
        {"exp", [](Second x) { return exp(x); }, e, e},
        {"log", [](Second x) { return log(x); }, 1.0 / a, -1.0 / (a * a)},
        {"sqrt", [](Second x) { return sqrt(x); }, 0.5 / std::sqrt(a), -0.25 / (a * std::sqrt(a))},
        {"abs", [](Second x) { return abs(-x); }, 1.0, 0.0},
        {"pow 3.5", [](Second x) { return pow(x, 3.5); }, 3.5 * std::pow(a, 2.5), 8.75 * std::pow(a, 1.5)},
        {"x^x", [](Second x) { return pow(x, x); }, std::pow(a, a) * (1.0 + ln),
         std::pow(a, a) * ((1.0 + ln) * (1.0 + ln) + 1.0 / a)},
        {"atan2(x, 2)", [](Second x) { return atan2(x, Second(2.0)); }, 2.0 / (4.0 + a * a),
         -4.0 * a / ((4.0 + a * a) * (4.0 + a * a))},
        {"x / (1 - x)", [](Second x) { return x / (1.0 - x); }, 1.0 / ((1.0 - a) * (1.0 - a)),
         2.0 / ((1.0 - a) * (1.0 - a) * (1.0 - a))},
        {"2 / x - x / 3", [](Second x) { return 2.0 / x - x / 3.0; }, -2.0 / (a * a) - 1.0 / 3.0, 4.0 / (a * a * a)},
        {"(x + x) * x - 5", [](Second x) { return (x + x) * x - 5.0; }, 4.0 * a, 4.0},
        {"3 x + x x", [](Second x) { return multiply_add(3.0, x, multiply_add(x, x, Second(0.0))); }, 3.0 + 2.0 * a,
         2.0}};
    Second x(0.6), y(1.1);
    x.value.partial[0] = 1.0;
    x.partial[0].value = 1.0;  // the one direction is that of x as well
    y.value.partial[1] = 1.0;
    for (const Row& row : rows) {
        CAPTURE(row.name);
        const Second z = row.f(x * y);
        const auto near = [](double expected) { return WithinAbs(expected, 1e-14 * (1.0 + std::abs(expected))); };
        CHECK_THAT(z.value.partial[0], near(row.first * 1.1));
        CHECK_THAT(z.value.partial[1], near(row.first * 0.6));
        CHECK_THAT(z.partial[0].value, near(row.first * 1.1));
        CHECK_THAT(z.partial[0].partial[0], near(row.second * 1.1 * 1.1));
        CHECK_THAT(z.partial[0].partial[1], near(row.first + row.second * a));
        CHECK(value_of(z) == z.value.value);
    }
    CHECK(vanishes(Second(0.0)));
    CHECK_FALSE(vanishes(x - 0.6));
}

TEST_CASE("comparisons look at the value", "[models][fast]") {
    CHECK(D::variable(1.0, 0) < D::variable(2.0, 1));
    CHECK(D::variable(1.0, 0) == D(1.0));
    CHECK(D(2.0) > 1.0);
    CHECK_FALSE(D(std::nan("")) <= 1.0);
    CHECK(value_of(D(4.0)) == 4.0);
    CHECK(value_of(4.0) == 4.0);
}

}  // namespace orbid::models::dual_test

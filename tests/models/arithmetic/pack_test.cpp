#include "models/arithmetic/pack.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#include "models/arithmetic/sine_and_cosine.hpp"
#include "tests/catch.hpp"

namespace orbid::models::pack_test {

namespace {

using Four = Pack<4>;

/// Numbers in [0, 1): a Weyl sequence, its low bits mixed in.
class Sequence {
public:
    double next() {
        state_ += 0x9e3779b97f4a7c15;
        return static_cast<double>((state_ ^ (state_ >> 29)) >> 11) * 0x1p-53;
    }

private:
    std::uint64_t state_ = 1;
};

double ulps(double value, long double exact) {
    const double rounded = static_cast<double>(exact);
    const double ulp = std::nextafter(std::abs(rounded), std::numeric_limits<double>::infinity()) - std::abs(rounded);
    return static_cast<double>(std::abs((value - exact) / ulp));
}

/// Largest error in units of the last place over 100 000 arguments in [low, high], a quarter of them near 0.
template <class F, class Exact>
double worst_error(const F& f, const Exact& exact, double low, double high) {
    Sequence numbers;
    double worst = 0.0;
    for (std::size_t i = 0; i < 100000 / Four::width; ++i) {
        std::array<double, Four::width> x;
        for (double& argument : x) {
            argument = low + (high - low) * numbers.next();
            if (i % 4 == 0 && low <= 0.0) argument *= std::pow(10.0, -12.0 * numbers.next());
        }
        const auto y = f(Four::load(x.data())).lanes();
        for (std::size_t l = 0; l < x.size(); ++l) {
            const double error = ulps(y[l], exact(static_cast<long double>(x[l])));
            if (!(error <= worst)) worst = error;
        }
    }
    return worst;
}

#define CHECK_FUNCTION(name, low, high)                                                                                \
    CHECK(worst_error([](const Four& x) { return name(x); }, [](long double x) { return std::name(x); }, low, high) <= \
          2.0)

/// The double next to k pi/2 and its sine and cosine, to 17 digits in 60 digits of working precision.
struct Near {
    double x, sine, cosine;
};
constexpr Near beside_multiples[] = {
    {1.5707963267948966, 1.0, 6.123233995736766e-17},  {3.141592653589793, 1.2246467991473532e-16, -1.0},
    {4.71238898038469, -1.0, -1.8369701987210297e-16}, {557.6326960121883, -1.0, -3.7724692239467775e-14},
    {1115.2653920243765, 7.544938447893555e-14, -1.0}, {1570801.039183877, -1.0, -6.10779806093597e-11},
    {4137479.0955740847, 1.0, -1.7939965719168827e-10}};

}  // namespace

TEST_CASE("functions of packs are right to two units of the last place", "[models][pack]") {
    // Largest measured: cos 1.7, sinh 1.6, the others less. 1e5: some 16 000 turns.
    CHECK_FUNCTION(sin, -4.0, 4.0);
    CHECK_FUNCTION(sin, -1e5, 1e5);
    CHECK_FUNCTION(cos, -4.0, 4.0);
    CHECK_FUNCTION(cos, -1e5, 1e5);
    CHECK_FUNCTION(tan, -10.0, 10.0);
    CHECK_FUNCTION(asin, -1.0, 1.0);
    CHECK_FUNCTION(acos, -1.0, 1.0);
    CHECK_FUNCTION(atan, -100.0, 100.0);
    CHECK_FUNCTION(sinh, -20.0, 20.0);
    CHECK_FUNCTION(cosh, -20.0, 20.0);
    CHECK_FUNCTION(tanh, -20.0, 20.0);
    CHECK_FUNCTION(exp, -700.0, 700.0);
    CHECK_FUNCTION(log, 0.5, 2.0);
    CHECK_FUNCTION(log, 1e-300, 1e300);
    CHECK_FUNCTION(sqrt, 0.0, 1e10);
    CHECK_FUNCTION(abs, -5.0, 5.0);
    CHECK(worst_error([](const Four& x) { return pow(x, -1.1); },
                      [](long double x) { return std::pow(x, static_cast<long double>(-1.1)); }, 1e-3, 1e3) <= 2.0);
    CHECK(worst_error([](const Four& x) { return atan2(x, Four(0.7)); },
                      [](long double x) { return std::atan2(x, static_cast<long double>(0.7)); }, -3.0, 3.0) <= 2.0);
}

TEST_CASE("sines beside a multiple of pi have an absolute error", "[models][pack]") {
    for (const int k : {1, 2, 3, 100, 31415, 1000000}) {
        const double x = static_cast<double>(k * std::acos(-1.0L));
        CAPTURE(k);
        // The remainder of pi after two doubles is 3.0e-33; 4e-33 a turn and two units of the last place.
        const long double exact = std::sin(static_cast<long double>(x));
        CHECK(std::abs(sin(Four(x)).lanes()[0] - exact) <= 4e-33L * k + 5e-16L * std::abs(exact));
    }
}

TEST_CASE("sines of what has no angle left are not a number", "[models][pack]") {
    const double infinite = std::numeric_limits<double>::infinity();
    for (const double x : {infinite, -infinite, std::nan("")}) {
        CHECK(std::isnan(sin(Four(x)).lanes()[0]));
        CHECK(std::isnan(cos(Four(x)).lanes()[0]));
    }
    if (detail::fused<xsimd::default_arch>)
        for (const double x : {1.2e15, -1e300})
            CHECK(std::isnan(sin(Four(x)).lanes()[0]));
    CHECK(!isfinite(Four(infinite)).any());
    CHECK(!isfinite(Four(std::nan(""))).any());
    CHECK(isfinite(Four(-1.7e308)).all());
}

TEST_CASE("sine and cosine of one number are right to one unit of the last place", "[models][pack]") {
    // Largest measured: 0.82. Here long double is exact enough but beside multiples of pi.
    Sequence numbers;
    double worst = 0.0;
    for (int i = 0; i < 200000; ++i) {
        // Up to and beyond 2^22, where the standard library takes over.
        const double x = std::ldexp(2.0 * numbers.next() - 1.0, i % 60 - 30);
        const auto [sine, cosine] = sine_and_cosine(x);
        worst = std::max({worst, ulps(sine, std::sin(static_cast<long double>(x))),
                          ulps(cosine, std::cos(static_cast<long double>(x)))});
    }
    CHECK(worst <= 1.0);
    for (const auto& [x, sine, cosine] : beside_multiples) {
        CAPTURE(x);
        CHECK_THAT(sine_and_cosine(x).sine, tests::WithinRel(sine, 2.5e-16));
        CHECK_THAT(sine_and_cosine(x).cosine, tests::WithinRel(cosine, 2.5e-16));
        CHECK_THAT(sine_and_cosine(-x).sine, tests::WithinRel(-sine, 2.5e-16));
    }
    CHECK(sine_and_cosine(0.0).sine == 0.0);
    CHECK(sine_and_cosine(0.0).cosine == 1.0);
    for (const double x : {std::numeric_limits<double>::infinity(), std::nan("")}) {
        CHECK(std::isnan(sine_and_cosine(x).sine));
        CHECK(std::isnan(sine_and_cosine(x).cosine));
    }
}

#ifdef __SSE4_1__
TEST_CASE("sines without fused operations are right to two units of the last place", "[models][pack]") {
    // Largest measured: 0.82, also beside multiples of pi/2, against sines of 113 bits. Here long double is exact
    // enough but beside multiples of pi.
    using Plain = Pack<1, xsimd::sse4_1>;
    STATIC_REQUIRE(!detail::fused<xsimd::sse4_1>);
    Sequence numbers;
    double worst = 0.0;
    for (int i = 0; i < 200000; ++i) {
        // Up to and beyond 2^22, where the standard library takes over.
        const double x = std::ldexp(2.0 * numbers.next() - 1.0, i % 60 - 30);
        CAPTURE(x);
        const Plain argument(x);
        worst = std::max(worst, ulps(sin(argument).lanes()[0], std::sin(static_cast<long double>(x))));
        worst = std::max(worst, ulps(cos(argument).lanes()[1], std::cos(static_cast<long double>(x))));
    }
    CHECK(worst <= 1.0);
    for (const auto& [x, sine, cosine] : beside_multiples) {
        CAPTURE(x);
        CHECK_THAT(sin(Plain(x)).lanes()[0], tests::WithinRel(sine, 2.5e-16));
        CHECK_THAT(cos(Plain(x)).lanes()[0], tests::WithinRel(cosine, 2.5e-16));
    }
    // A lane that the library computes leaves its neighbour alone.
    const std::array<double, 2> mixed{0.3, 1e9};
    CHECK(sin(Plain::load(mixed.data())).lanes()[0] == sin(Plain(0.3)).lanes()[0]);
    CHECK(sin(Plain::load(mixed.data())).lanes()[1] == std::sin(1e9));
    CHECK(std::isnan(sin(Plain(std::numeric_limits<double>::infinity())).lanes()[0]));
}
#endif

TEST_CASE("a lane does not know its neighbours", "[models][pack]") {
    // Each function with a lane among others of other sizes, with nan and with infinity, and alone in a small pack.
    const auto check = [](const auto& f, double x) {
        CAPTURE(x);
        std::array<double, Four::width> among;
        for (std::size_t l = 0; l < among.size(); ++l)
            among[l] = l % 3 == 0 ? 1e-9 * static_cast<double>(l) : l % 3 == 1 ? 1e7 : std::nan("");
        for (std::size_t l = 0; l < among.size(); ++l) {
            auto arguments = among;
            arguments[l] = x;
            const double inside = f(Four::load(arguments.data())).lanes()[l];
            const double alone = f(Pack<1>(x)).lanes()[0];
            CHECK(std::memcmp(&inside, &alone, sizeof inside) == 0);
        }
    };
    for (const double x : {0.3, -0.9, 0.011, 1e-8}) {
        check([](const auto& a) { return sin(a); }, 40.0 * x);
        check([](const auto& a) { return cos(a); }, 40.0 * x);
        check([](const auto& a) { return tan(a); }, 40.0 * x);
        check([](const auto& a) { return asin(a); }, x);
        check([](const auto& a) { return acos(a); }, x);
        check([](const auto& a) { return atan(a); }, x);
        check([](const auto& a) { return sinh(a); }, 3.0 * x);
        check([](const auto& a) { return cosh(a); }, 3.0 * x);
        check([](const auto& a) { return tanh(a); }, 3.0 * x);
        check([](const auto& a) { return exp(a); }, 10.0 * x);
        check([](const auto& a) { return log(a); }, std::abs(x));
        check([](const auto& a) { return sqrt(a); }, std::abs(x));
        check([](const auto& a) { return pow(a, 1.7); }, std::abs(x));
        check([](const auto& a) { return a / (a + 0.1) - 2.0 * a; }, x);
        check([](const auto& a) { return fma(1.7, a, a); }, x);
    }
}

TEST_CASE("packs compute and compare lane by lane", "[models][pack]") {
    std::array<double, Four::width> x, y;
    for (std::size_t l = 0; l < x.size(); ++l) {
        x[l] = static_cast<double>(l) - 5.5;
        y[l] = 2.0 * static_cast<double>(l % 5) - 3.0;
    }
    const Four a = Four::load(x.data()), b = Four::load(y.data());
    const auto sum = (a + b).lanes(), quotient = (a / b).lanes(), chosen = select(a < b, a, b).lanes();
    const auto less = (a < b).lanes(), equal = (a == b).lanes(), at_most = (a <= b).lanes();
    const auto least = min(a, b).lanes(), signed_by = copysign(a, b).lanes(), fused = fma(a, b, a).lanes();
    for (std::size_t l = 0; l < x.size(); ++l) {
        CHECK(sum[l] == x[l] + y[l]);
        CHECK(quotient[l] == x[l] / y[l]);
        CHECK(less[l] == (x[l] < y[l]));
        CHECK(equal[l] == (x[l] == y[l]));
        CHECK(at_most[l] == (x[l] <= y[l]));
        CHECK(chosen[l] == std::min(x[l], y[l]));
        CHECK(least[l] == std::min(x[l], y[l]));
        CHECK(signed_by[l] == std::copysign(x[l], y[l]));
        CHECK(fused[l] == x[l] * y[l] + x[l]);  // multiples of 1/4: nothing is rounded
    }
    CHECK((a < b).any());
    CHECK(!(a < b).all());
    CHECK(((a < b) | !(a < b)).all());
    CHECK(!((a < b) & !(a < b)).any());
    Four c = 1.0 - a;
    c *= 2.0;
    CHECK(c.lanes()[0] == 13.0);
}

}  // namespace orbid::models::pack_test

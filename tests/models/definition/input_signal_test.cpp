#include "models/definition/input_signal.hpp"

#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <utility>

#include "models/definition/wrong_data.hpp"
#include "tests/catch.hpp"

namespace orbid::models::input_signal_test {
namespace {

using tests::ContainsSubstring;
using tests::WithinAbs;
constexpr auto linear = InputSignal::Interpolation::linear;
constexpr auto cubic = InputSignal::Interpolation::cubic;
constexpr auto held = InputSignal::Interpolation::held;
constexpr auto band_limited = InputSignal::Interpolation::band_limited;

double value_at(const InputSignal& signal, double t) {
    std::vector<double> values(signal.count());
    signal.evaluate(signal.piece_at(t), t, values.data());
    return values.back();
}

InputSignal sampled(const auto& f, double begin, double end, std::size_t pieces, InputSignal::Interpolation how) {
    std::vector<double> times, values;
    for (std::size_t k = 0; k <= pieces; ++k) {
        times.push_back(begin + (end - begin) * static_cast<double>(k) / static_cast<double>(pieces));
        values.push_back(f(times.back()));
    }
    return InputSignal(times, values, 1, how);
}

}  // namespace

TEST_CASE("straight lines between values", "[models][reference]") {
    const std::vector<double> times{-1.0, 0.5, 2.0, 2.25};
    // Two inputs beside each other.
    const std::vector<double> values{1.0, 10.0, 4.0, -2.0, 0.0, 7.0, 1.0, 7.0};
    const InputSignal signal(times, values, 2, linear);
    CHECK(signal.count() == 2);
    CHECK(signal.first_time() == -1.0);
    CHECK(signal.last_time() == 2.25);
    std::array<double, 2> u;
    for (std::size_t k = 0; k < 3; ++k)
        for (const double part : {0.0, 0.25, 0.5, 1.0}) {
            signal.evaluate(k, times[k] + part * (times[k + 1] - times[k]), u.data());
            for (std::size_t i = 0; i < 2; ++i)
                CHECK_THAT(u[i], WithinAbs((1.0 - part) * values[2 * k + i] + part * values[2 * k + 2 + i], 1e-14));
        }
}

TEST_CASE("pieces begin at their instant", "[models][fast]") {
    const InputSignal signal(std::vector{0.0, 1.0, 2.0, 3.0}, std::vector{0.0, 0.0, 0.0, 0.0}, 1, linear);
    CHECK(signal.piece_at(-5.0) == 0);
    CHECK(signal.piece_at(0.0) == 0);
    CHECK(signal.piece_at(std::nextafter(1.0, 0.0)) == 0);
    CHECK(signal.piece_at(1.0) == 1);
    CHECK(signal.piece_at(2.0) == 2);
    CHECK(signal.piece_at(3.0) == 2);
    CHECK(signal.piece_at(9.0) == 2);
    const InputSignal shortest(std::vector{0.0, 1.0}, std::vector{2.0, 3.0}, 1, cubic);
    CHECK(shortest.piece_at(0.5) == 0);
    // A spline through two points is a line.
    CHECK(value_at(shortest, 0.25) == 2.25);
}

TEST_CASE("the natural cubic spline", "[models][reference]") {
    const std::vector<double> times{0.0, 0.7, 1.0, 2.5, 3.1, 4.0};
    const std::vector<double> values{1.0, -2.0, 0.5, 3.0, 3.5, -1.0};
    const InputSignal signal(times, values, 1, cubic);
    const auto piece_at = [&](std::size_t piece, double t) {
        double u;
        signal.evaluate(piece, t, &u);
        return u;
    };
    // Exact derivatives of a cubic by differences of any step.
    const auto slope = [&](std::size_t piece, double t) {
        return (8.0 * (piece_at(piece, t + 0.5) - piece_at(piece, t - 0.5)) -
                (piece_at(piece, t + 1.0) - piece_at(piece, t - 1.0))) /
               6.0;
    };
    const auto bend = [&](std::size_t piece, double t) {
        return piece_at(piece, t + 1.0) - 2.0 * piece_at(piece, t) + piece_at(piece, t - 1.0);
    };
    for (std::size_t k = 0; k < times.size(); ++k)
        CHECK_THAT(value_at(signal, times[k]), WithinAbs(values[k], 1e-14));
    for (std::size_t k = 1; k + 1 < times.size(); ++k) {
        CAPTURE(k);
        CHECK_THAT(piece_at(k - 1, times[k]), WithinAbs(values[k], 1e-14));
        // Numbers of size 100 are subtracted.
        CHECK_THAT(slope(k - 1, times[k]) - slope(k, times[k]), WithinAbs(0.0, 1e-12));
        CHECK_THAT(bend(k - 1, times[k]) - bend(k, times[k]), WithinAbs(0.0, 1e-12));
    }
    CHECK_THAT(bend(0, times.front()), WithinAbs(0.0, 1e-12));
    CHECK_THAT(bend(4, times.back()), WithinAbs(0.0, 1e-12));
    // A straight line stays one, to rounding.
    const auto line = sampled([](double t) { return 3.0 * t - 2.0; }, 0.0, 1.0, 7, cubic);
    for (double t = 0.0; t <= 1.0; t += 0.01)
        CHECK_THAT(value_at(line, t), WithinAbs(3.0 * t - 2.0, 1e-14));
    // t^3, then its mirror image in (1, 1) that comes to rest with u'' = 0: u'' = 6 t and 6 (2 - t), so that the spline
    // through three of its points is the function itself.
    const auto mirrored = [](double t) {
        const double d = t - 1.0;
        return t < 1.0 ? t * t * t : 1.0 + 3.0 * d + 3.0 * d * d - d * d * d;
    };
    const auto itself = sampled(mirrored, 0.0, 2.0, 2, cubic);
    for (double t = 0.0; t <= 2.0; t += 0.125)
        CHECK_THAT(value_at(itself, t), WithinAbs(mirrored(t), 1e-14));
}

TEST_CASE("order of interpolation: two for lines, four for cubics inside", "[models][reference]") {
    const auto f = [](double t) { return std::sin(3.0 * t) + 0.2 * t * t; };
    const auto error = [&](std::size_t pieces, InputSignal::Interpolation how) {
        const auto signal = sampled(f, 0.0, 4.0, pieces, how);
        double worst = 0.0;
        // u'' = 0 at the ends is wrong for this function; the influence decays by 2 + sqrt(3) per piece.
        for (double t = 1.0; t < 3.0; t += 0.0037)
            worst = std::max(worst, std::abs(value_at(signal, t) - f(t)));
        return worst;
    };
    for (const std::size_t pieces : {64U, 128U, 256U}) {
        CAPTURE(pieces);
        // Worst points do not lie on the grid of t: some percent.
        CHECK_THAT(std::log2(error(pieces, linear) / error(2 * pieces, linear)), WithinAbs(2.0, 0.1));
        CHECK_THAT(std::log2(error(pieces, cubic) / error(2 * pieces, cubic)), WithinAbs(4.0, 0.1));
    }
}

TEST_CASE("held values jump at their instants", "[models][reference]") {
    const InputSignal signal(std::vector{0.0, 1.0, 2.5}, std::vector{3.0, -1.0, 7.0}, 1, held);
    for (const auto& [t, u] : {std::pair{0.0, 3.0}, {0.999, 3.0}, {1.0, -1.0}, {2.4, -1.0}, {2.5, -1.0}})
        CHECK(value_at(signal, t) == u);
    std::array<double, 3> terms;
    signal.expand(1, 1.5, terms.data());
    CHECK(terms == std::array{-1.0, 0.0, 0.0});
}

TEST_CASE("band-limited signals", "[models][reference]") {
    // A sine with r samples per period, away from the ends; the worst error relative to its amplitude.
    const auto error = [](double samples_per_period) {
        const double omega = 2.0 * std::numbers::pi / samples_per_period;
        const auto sine = [&](double t) { return std::sin(omega * t + 0.3); };
        const auto signal = sampled(sine, 0.0, 400.0, 400, band_limited);
        double worst = 0.0;
        for (double t = 100.0; t < 300.0; t += 0.0371)
            worst = std::max(worst, std::abs(value_at(signal, t) - sine(t)));
        return worst;
    };
    CHECK(error(2.5) < 2e-4);
    CHECK(error(3.0) < 5e-5);
    CHECK(error(4.0) < 5e-6);
    CHECK(error(8.0) < 5e-8);
    CHECK(error(100.0) < 5e-8);
    // Value, u' and u'' / 2 are those of one smooth function: they agree where pieces meet.
    const auto f = [](double t) { return std::sin(1.7 * t) + 0.1 * t; };
    const auto smooth = sampled(f, 0.0, 60.0, 80, band_limited);
    for (std::size_t k = 1; k < 80; ++k) {
        std::array<double, 3> left, right;
        smooth.expand(k - 1, smooth.times()[k], left.data());
        smooth.expand(k, smooth.times()[k], right.data());
        CAPTURE(k);
        for (std::size_t i = 0; i < 3; ++i)
            CHECK_THAT(left[i] - right[i], WithinAbs(0.0, 1e-11));
        CHECK_THAT(right[0], WithinAbs(f(smooth.times()[k]), 1e-14));
    }
    // A constant stays one to the last digit; a line within the ripple of the window, at the ends too.
    const auto constant = sampled([](double) { return 0.1; }, 0.0, 1.0, 10, band_limited);
    const auto line = sampled([](double t) { return 3.0 * t - 2.0; }, 0.0, 1.0, 10, band_limited);
    for (double t = 0.0; t <= 1.0; t += 0.01) {
        CHECK(value_at(constant, t) == 0.1);
        CHECK_THAT(value_at(line, t), WithinAbs(3.0 * t - 2.0, 1e-7));
    }
    const InputSignal shortest(std::vector{0.0, 1.0}, std::vector{2.0, 3.0}, 1, band_limited);
    CHECK_THAT(value_at(shortest, 0.25), WithinAbs(2.25, 1e-6));
}

TEST_CASE("signals that are refused", "[models][fast]") {
    const auto wrong_call = [](const std::vector<double>& times, const std::vector<double>& values, std::size_t count,
                               const std::string& message) {
        CHECK_THROWS_AS(InputSignal(times, values, count, cubic), std::invalid_argument);
        CHECK_THROWS_WITH(InputSignal(times, values, count, cubic), ContainsSubstring(message));
    };
    wrong_call({0.0, 1.0}, {}, 0, "number of inputs is 0");
    wrong_call({0.0, 1.0}, {1.0, 2.0, 3.0}, 1, "number of values is 3, must be 2");

    const auto wrong_data = [](const std::vector<double>& times, const std::vector<double>& values, std::size_t count,
                               const std::string& message) {
        CHECK_THROWS_AS(InputSignal(times, values, count, cubic), DataError);
        CHECK_THROWS_WITH(InputSignal(times, values, count, cubic), ContainsSubstring(message));
    };
    const double nan = std::numeric_limits<double>::quiet_NaN();
    wrong_data({0.0}, {1.0}, 1, "number of instants is 1, must be >= 2");
    wrong_data({0.0, 1.0, 1.0}, {1.0, 2.0, 3.0}, 1, "time 2 is 1 s, must be > 1 s");
    wrong_data({0.0, 1.0, 0.5}, {1.0, 2.0, 3.0}, 1, "time 2 is 0.5 s, must be > 1 s");
    wrong_data({0.0, nan}, {1.0, 2.0}, 1, "time 1 is nan");
    wrong_data({0.0, 1.0}, {1.0, 2.0, 3.0, nan}, 2, "value 1 of input 1 is nan");
    CHECK_THROWS_AS(InputSignal(std::vector{0.0, 1.0, 2.2}, std::vector{1.0, 2.0, 3.0}, 1, band_limited), DataError);
    CHECK_THROWS_WITH(InputSignal(std::vector{0.0, 1.0, 2.2}, std::vector{1.0, 2.0, 3.0}, 1, band_limited),
                      ContainsSubstring("time 1 is 1 s, must be 1.1 s within 5 % of a step"));
}

}  // namespace orbid::models::input_signal_test

#include "orbits/invariants/cycle_expansion.hpp"

#include <array>
#include <cmath>
#include <complex>
#include <fstream>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "orbits/invariants/kaplan_yorke.hpp"
#include "tests/catch.hpp"
#include "tests/source_folder.hpp"

namespace cycle_expansion_test {

using namespace orbid;
using Catch::Matchers::WithinAbs;
using Catch::Matchers::WithinRel;
using orbits::Cycle;
using orbits::CycleExpansion;
using orbits::expand_cycles;

namespace {

Cycle cycle(int period, std::vector<std::complex<double>> multipliers) {
    Cycle result;
    result.period = period;
    result.multipliers = std::move(multipliers);
    return result;
}

// Prime words of two symbols up to a length, one of each cyclic class: its smallest rotation.
std::vector<std::string> prime_words(int longest) {
    std::vector<std::string> words;
    for (int length = 1; length <= longest; ++length)
        for (int bits = 0; bits < 1 << length; ++bits) {
            std::string word;
            for (int i = length - 1; i >= 0; --i)
                word.push_back((bits >> i) & 1 ? '1' : '0');
            bool smallest = true;
            for (int shift = 1; shift < length; ++shift)
                smallest = smallest && word < word.substr(static_cast<std::size_t>(shift)) +
                                                  word.substr(0, static_cast<std::size_t>(shift));
            if (smallest) words.push_back(word);
        }
    return words;
}

// Cycles of a full shift of two symbols whose multipliers are products over the symbols.
std::vector<Cycle> full_shift(int longest, const std::array<std::vector<double>, 2>& factors,
                              const std::array<double, 2>& times = {std::nan(""), std::nan("")}) {
    std::vector<Cycle> cycles;
    for (const std::string& word : prime_words(longest)) {
        std::vector<std::complex<double>> multipliers(factors[0].size(), 1.0);
        double time = 0.0;
        for (const char symbol : word) {
            const auto s = static_cast<std::size_t>(symbol - '0');
            for (std::size_t d = 0; d < multipliers.size(); ++d)
                multipliers[d] *= factors[s][d];
            time += times[s];
        }
        cycles.push_back(cycle(static_cast<int>(word.size()), multipliers));
        cycles.back().time = time;
    }
    return cycles;
}

nlohmann::json reference(const std::string& file) {
    std::ifstream stream(orbid::tests::source_folder() + "/tests/reference/" + file);
    return nlohmann::json::parse(stream);
}

double number(const nlohmann::json& value) {
    return std::stod(value.get<std::string>());
}

// The attractor's cycles: the fixed point at x = -1.13 lies outside and is left out.
std::vector<Cycle> henon_cycles() {
    std::vector<Cycle> cycles;
    const nlohmann::json table = reference("henon_cycles.json");
    for (const auto& entry : table["cycles"])
        if (number(entry["x"]) > -1.1)
            cycles.push_back(
                cycle(entry["period"], {number(entry["unstable_multiplier"]), number(entry["stable_multiplier"])}));
    return cycles;
}

// Cycles of a flow with codes; the contracting multiplier by Liouville from the mean divergence where it is constant.
std::vector<Cycle> flow_cycles(const std::string& file, std::size_t longest, double divergence) {
    std::vector<Cycle> cycles;
    const nlohmann::json table = reference(file);
    for (const auto& entry : table["cycles"]) {
        const auto length = entry["code"].get<std::string>().size();
        if (length > longest) continue;
        const double unstable = number(entry["unstable_multiplier"]), time = number(entry["period"]);
        cycles.push_back(cycle(static_cast<int>(length), {unstable}));
        if (divergence < 0.0) cycles.back().multipliers.emplace_back(std::exp(divergence * time) / unstable);
        cycles.back().time = time;
    }
    return cycles;
}

constexpr double ln2 = 0.69314718055994530942;

}  // namespace

TEST_CASE("cycle expansion of a full shift with constant slope is exact", "[orbits][expansion]") {
    // The determinant is prod_k (1 - largest z q^k), k = 0, 1, ...; Euler: its coefficient of z^n is
    // (-largest)^n q^(n (n - 1) / 2) / ((1 - q) ... (1 - q^n)).
    struct Case {
        const char* name;
        std::array<std::vector<double>, 2> slopes;
        double largest, q;
        bool continuous;
    };
    const std::vector<Case> cases{
        {"tent map", {{{2.0}, {-2.0}}}, 1.0, 0.25, true},
        {"doubling map", {{{2.0}, {2.0}}}, 1.0, 0.5, false},  // of an interval with a tear
        {"tripling map with a hole", {{{3.0}, {3.0}}}, 2.0 / 3.0, 1.0 / 3.0, false},
    };
    for (const Case& c : cases) {
        CAPTURE(c.name);
        const auto expansion = expand_cycles(full_shift(9, c.slopes), {9, c.continuous});
        double coefficient = 1.0;
        for (const auto& term : expansion.by_period) {
            CAPTURE(term.period);
            coefficient *= -c.largest * std::pow(c.q, term.period - 1) / (1.0 - std::pow(c.q, term.period));
            // The recursion cancels sums of order one: absolute rounding.
            CHECK_THAT(term.coefficient, WithinAbs(coefficient, 1e-14));
        }
        const auto& answer = expansion.answer();
        // What is left out: F's remaining coefficients, at most 1e-11 (q = 1/2), over F' = prod (1 - q^k) >= 0.28.
        CHECK_THAT(answer.escape_rate, WithinAbs(-std::log(c.largest), 1e-10));
        CHECK_THAT(answer.determinant_zero, WithinRel(1.0 / c.largest, 1e-10));
        CHECK_THAT(answer.exponents[0], WithinRel(std::log(std::abs(c.slopes[0][0])), 1e-9));
        CHECK_THAT(answer.metric_entropy, WithinAbs(ln2, 1e-9));
        // These two are polynomials, 1 - 2 z and 1 - 2 z / slope.
        CHECK_THAT(answer.topological_entropy, WithinAbs(ln2, 1e-12));
        CHECK_THAT(answer.zeta_zero, WithinRel(1.0 / c.largest, 1e-12));
        if (c.largest == 1.0) CHECK_THAT(answer.conservation, WithinAbs(0.0, 1e-10));
    }
}

TEST_CASE("expansion of a baker's map", "[orbits][expansion]") {
    // Zeros of the determinant at 2^j 20^k: coefficients at period 9 below 1e-9.
    const auto expansion = expand_cycles(full_shift(9, {{{2.0, 0.05}, {2.0, 0.05}}}), {9, false});
    const auto& answer = expansion.answer();
    CHECK_THAT(answer.escape_rate, WithinAbs(0.0, 1e-7));
    CHECK_THAT(answer.exponents[0], WithinAbs(ln2, 1e-6));
    CHECK_THAT(answer.exponents[1], WithinAbs(std::log(0.05), 1e-6));
    CHECK_THAT(answer.dimension, WithinAbs(1.0 - ln2 / std::log(0.05), 1e-6));
}

TEST_CASE("unequal slopes and return times solve the one-letter equation", "[orbits][expansion]") {
    // sum_i e^(-s tau_i) / slope_i = 1 for the leading zero; exponents are means with those weights. Baker's map with
    // strips 0.3 and 0.6 (0.1 escapes), contraction 0.01 and 0.02, roof times 0.8 and 1.7.
    const std::array<double, 2> share{0.3, 0.6}, thin{0.01, 0.02}, time{0.8, 1.7};
    double s = 0.0;
    for (int i = 0; i < 100; ++i) {
        const double a = share[0] * std::exp(-s * time[0]), b = share[1] * std::exp(-s * time[1]);
        s += (a + b - 1.0) / (a * time[0] + b * time[1]);
    }
    const double w0 = share[0] * std::exp(-s * time[0]), w1 = share[1] * std::exp(-s * time[1]);
    const double mean_time = w0 * time[0] + w1 * time[1];
    const auto cycles = full_shift(9, {{{1.0 / share[0], thin[0]}, {1.0 / share[1], thin[1]}}}, time);
    const auto expansion = expand_cycles(cycles, {9, false});
    REQUIRE(expansion.timed);
    const auto& answer = expansion.answer();
    CHECK_THAT(answer.escape_rate, WithinAbs(-s, 2e-9));
    CHECK_THAT(answer.mean_time, WithinAbs(mean_time, 2e-8));
    CHECK_THAT(answer.exponents[0], WithinAbs(-(w0 * std::log(share[0]) + w1 * std::log(share[1])) / mean_time, 2e-8));
    CHECK_THAT(answer.exponents[1], WithinAbs((w0 * std::log(thin[0]) + w1 * std::log(thin[1])) / mean_time, 2e-8));
    CHECK_THAT(answer.zeta_zero, WithinRel(1.0 / 0.9, 1e-12));
    // Topological: e^(-h 0.8) + e^(-h 1.7) = 1.
    const double h = answer.topological_entropy;
    CHECK_THAT(std::exp(-0.8 * h) + std::exp(-1.7 * h), WithinAbs(1.0, 1e-12));
}

TEST_CASE("logistic map at 4: errors halve with every period", "[orbits][expansion]") {
    // Conjugate to the tent map, so multipliers are 2^p, but for the corner at 0: 4. Its term puts a pole of the
    // determinant at z = 2, the coefficients fall like 2^-n and no faster.
    auto cycles = full_shift(10, {{{2.0}, {-2.0}}});
    cycles.front().multipliers = {4.0};
    const auto expansion = expand_cycles(cycles, {10, true});
    CHECK(expansion.index_sums == std::vector<int>(10, 0));  // the line into itself, both ends to -infinity
    const auto& before = expansion.by_period[8];
    const auto& answer = expansion.answer();
    // Next term of the ratios 1/2 (1 + O(2^-n)).
    CHECK_THAT(answer.escape_rate / before.escape_rate, WithinAbs(0.5, 0.01));
    CHECK_THAT((answer.exponents[0] - ln2) / (before.exponents[0] - ln2), WithinAbs(0.5, 0.01));
    CHECK_THAT(answer.coefficient / before.coefficient, WithinAbs(0.5, 0.01));
    CHECK_THAT(answer.topological_entropy, WithinAbs(ln2, 1e-12));
}

TEST_CASE("Henon's cycles to period 8 give the published zero and exponent", "[orbits][expansion]") {
    const auto expansion = expand_cycles(henon_cycles(), {8, true});
    CHECK(expansion.index_sums == std::vector<int>(8, 1));  // a disc into itself
    REQUIRE(expansion.by_period.size() == 8);
    const auto& answer = expansion.answer();
    CHECK(answer.cycles == 16);
    // Published to four decimals; the digits behind and F(1) were computed once more apart, in double precision.
    CHECK_THAT(answer.determinant_zero, WithinAbs(1.0271, 5e-5));
    CHECK_THAT(answer.exponents[0], WithinAbs(0.4934, 5e-5));
    CHECK_THAT(answer.determinant_zero, WithinRel(1.0270619957, 1e-9));
    CHECK_THAT(answer.conservation, WithinAbs(0.0735384232878594, 1e-12));
    CHECK_THAT(answer.escape_rate, WithinRel(std::log(1.0270619957), 1e-8));
    // Areas shrink by exactly 0.3: whatever the weights, the exponents sum to ln 0.3.
    CHECK_THAT(answer.exponents.sum(), WithinRel(std::log(0.3), 1e-9));
    CHECK_THAT(answer.zeta_zero, WithinRel(1.0213837738532765, 1e-9));
    // 63 points of period 8 and the like; the entropy is 0.465 (its digits need cycles to period 20 and more).
    CHECK_THAT(answer.topological_entropy, WithinAbs(0.465, 0.02));
    CHECK(answer.dimension == orbits::kaplan_yorke_dimension(answer.exponents));
    // Longer cycles in the list change nothing.
    const auto shorter = expand_cycles(henon_cycles(), {7, true});
    CHECK(shorter.answer().exponents == expansion.by_period[6].exponents);
}

TEST_CASE("a list without one of Henon's cycles is refused", "[orbits][expansion]") {
    const auto cycles = henon_cycles();
    REQUIRE(cycles.size() == 16);
    for (std::size_t left_out = 0; left_out < cycles.size(); ++left_out) {
        CAPTURE(left_out);
        auto list = cycles;
        list.erase(list.begin() + static_cast<std::ptrdiff_t>(left_out));
        CHECK_THROWS_WITH(expand_cycles(list, {8, true}), tests::ContainsSubstring("not complete"));
        list = cycles;
        list.push_back(cycles[left_out]);
        CHECK_THROWS_WITH(expand_cycles(list, {8, true}), tests::ContainsSubstring("not complete"));
    }
}

TEST_CASE("cycles of flows with times", "[orbits][expansion]") {
    // Roessler: complete to seven loops (index sums 1: a disc into itself), at eight not.
    const auto rossler = flow_cycles("rossler_orbits.json", 8, 0.0);
    const auto expansion = expand_cycles(rossler, {7, true});
    REQUIRE(expansion.timed);
    CHECK(expansion.index_sums == std::vector<int>(7, 1));
    // The exponent in the literature is 0.0714 per second, the mean return time from a long run 5.86: truncation
    // errors 5 %, 0.1 %, and an escape of 0.0064 where none is.
    CHECK_THAT(expansion.answer().exponents[0], WithinAbs(0.0714, 0.005));
    CHECK_THAT(expansion.answer().mean_time, WithinAbs(5.86, 0.02));
    CHECK_THAT(expansion.answer().escape_rate, WithinAbs(0.0, 0.01));
    CHECK_THROWS_WITH(expand_cycles(rossler, {8, true}), tests::ContainsSubstring("period 8"));
    // Lorenz: its section tears, so index sums say nothing. To four loops 0.957, in the literature 0.9056: slow, since
    // the one-loop cycles of the full shift are missing; the errors of period 2, 3, 4 fall.
    const auto lorenz = expand_cycles(flow_cycles("lorenz_orbits.json", 4, -41.0 / 3.0), {4, false});
    const auto error = [&](std::size_t period) { return lorenz.by_period[period - 1].exponents[0] - 0.9056; };
    CHECK(std::abs(error(4)) < 0.06);
    CHECK(std::abs(error(3)) < std::abs(error(2)));
    CHECK(std::abs(error(4)) < std::abs(error(3)));
    CHECK(lorenz.by_period[3].conservation < lorenz.by_period[2].conservation);
    // Liouville: constant divergence.
    CHECK_THAT(lorenz.answer().exponents.sum(), WithinRel(-41.0 / 3.0, 1e-9));
    CHECK(std::isnan(lorenz.by_period[0].escape_rate));  // no cycle of one loop
}

TEST_CASE("the pendulum's cycles are complete: index sums of a cylinder", "[orbits][expansion]") {
    std::vector<Cycle> cycles;
    const nlohmann::json table = reference("pendulum_orbits_g9.81.json");
    for (const auto& entry : table["cycles"]) {
        const std::vector<std::complex<double>> multipliers{entry["unstable_multiplier"].get<double>(),
                                                            entry["stable_multiplier"].get<double>()};
        cycles.push_back(cycle(entry["period"], multipliers));
        cycles.back().mirror = cycles.size() - 1;
        if (entry["mirror_symmetric"]) continue;
        cycles.back().mirror = cycles.size();
        cycles.push_back(cycle(entry["period"], multipliers));
        cycles.back().mirror = cycles.size() - 2;
    }
    REQUIRE(cycles.size() == 6 + 9 + 28);
    const auto expansion = expand_cycles(cycles, {3, true});
    CHECK(expansion.index_sums == std::vector<int>(3, 0));
    // Direct integration: 0.758 per period. Three periods of cycles are few: 0.691, and an escape of -0.11 that is
    // none.
    CHECK_THAT(expansion.answer().exponents[0], WithinAbs(0.758, 0.1));
    cycles.pop_back();
    CHECK_THROWS_WITH(expand_cycles(cycles, {3, true}), tests::ContainsSubstring("mirror partner"));
}

TEST_CASE("sds of multipliers reach the answer", "[orbits][expansion]") {
    // Two fixed points of one expanding direction: F = 1 - z t, t = sum 1 / (m_i - 1), s = ln t, so
    // ds/dln m_i = -m_i / ((m_i - 1)^2 t).
    std::vector<Cycle> cycles{cycle(1, {2.5}), cycle(1, {4.0})};
    const std::array<double, 2> sds{1e-4, 3e-4};
    const double t = 1.0 / 1.5 + 1.0 / 3.0;
    for (std::size_t i = 0; i < 2; ++i)
        cycles[i].ln_multiplier_covariance = Eigen::MatrixXd::Constant(1, 1, sds[i] * sds[i]);
    const double first = 2.5 / (1.5 * 1.5 * t) * sds[0], second = 4.0 / (9.0 * t) * sds[1];
    // Steps of one sd: relative error of the order of the sd.
    CHECK_THAT(expand_cycles(cycles, {1, false}).escape_rate_sd, WithinRel(std::hypot(first, second), 1e-3));
    // Partners of a mirror pair rest on the same data and move together.
    cycles[1] = cycles[0];
    cycles[0].mirror = 1;
    cycles[1].mirror = 0;
    const double both = 2.0 * 2.5 / (1.5 * 1.5 * (2.0 / 1.5)) * sds[0];
    CHECK_THAT(expand_cycles(cycles, {1, false}).escape_rate_sd, WithinRel(both, 1e-3));
    CHECK(expand_cycles(henon_cycles(), {8, true}).exponent_sds == Eigen::VectorXd::Zero(2));
}

TEST_CASE("expansions refuse what they cannot mean", "[orbits][expansion]") {
    const auto good = full_shift(4, {{{2.0}, {-2.0}}});
    CHECK_NOTHROW(expand_cycles(good, {4, true}));
    CHECK_THROWS_WITH(expand_cycles(good, {0, true}),
                      tests::ContainsSubstring("complete_to must be in [1, 64], got 0"));
    CHECK_THROWS_AS(expand_cycles(good, {65, true}), std::invalid_argument);
    CHECK_THROWS_WITH(expand_cycles({}, {4, true}), tests::ContainsSubstring("no cycle"));
    const auto refused = [&](const std::function<void(Cycle&)>& spoil, const std::string& why) {
        auto list = good;
        spoil(list[2]);
        CHECK_THROWS_WITH(expand_cycles(list, {4, true}), tests::ContainsSubstring(why));
    };
    refused([](Cycle& c) { c.period = 0; }, "must be positive");
    refused([](Cycle& c) { c.multipliers.emplace_back(0.1); }, "multipliers");
    refused([](Cycle& c) { c.multipliers.clear(); }, "multipliers");
    refused([](Cycle& c) { c.multipliers[0] = std::nan(""); }, "modulus nan");
    refused([](Cycle& c) { c.multipliers[0] = -1.0; }, "not 1");
    refused([](Cycle& c) { c.multipliers[0] = 0.5; }, "stable");
    refused([](Cycle& c) { c.time = 2.0; }, "times");
    refused([](Cycle& c) { c.mirror = 0; }, "mirror partner");
    refused([](Cycle& c) { c.mirror = 1000; }, "mirror partner");
    refused([](Cycle& c) { c.multipliers[0] *= -1.0; }, "not complete");
}

TEST_CASE("Kaplan-Yorke dimension", "[orbits][expansion]") {
    using Eigen::VectorXd;
    const auto dimension = [](std::initializer_list<double> exponents) {
        return orbits::kaplan_yorke_dimension(
            Eigen::Map<const VectorXd>(exponents.begin(), static_cast<Eigen::Index>(exponents.size())));
    };
    CHECK(dimension({0.5, -1.0}) == 1.5);
    CHECK_THAT(dimension({0.9056, 0.0, -14.5723}), WithinRel(2.0 + 0.9056 / 14.5723, 1e-15));
    CHECK(dimension({-0.5, -1.0}) == 0.0);
    CHECK(dimension({0.5, -0.2}) == 2.0);
    CHECK(dimension({0.5, -std::numeric_limits<double>::infinity()}) == 1.0);
    CHECK(std::isnan(dimension({std::nan(""), -1.0})));
    CHECK(dimension({-0.5, std::nan("")}) == 0.0);
}

}  // namespace cycle_expansion_test

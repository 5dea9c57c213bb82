// Several threads of a program call the rooms at once, with the objects that may be shared between them (a system, a
// series) shared: each gets the bytes that it gets alone.

#include <cmath>
#include <cstring>
#include <functional>
#include <stdexcept>

#include "estimator/estimate/estimate.hpp"
#include "models/catalogue/registry.hpp"
#include "models/equations/equation_text.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/series_residuals/series_residual.hpp"
#include "periodic/solution/multiple_shooting.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/sections/map_series.hpp"
#include "tests/threads/at_once.hpp"

using namespace orbid;

namespace {

using Numbers = std::vector<double>;

constexpr std::size_t callers = 8;

void append(Numbers& numbers, const Eigen::MatrixXd& values) {
    numbers.insert(numbers.end(), values.data(), values.data() + values.size());
}

/// To the bit: nan is equal to itself, and 0 is not -0.
bool same(const Numbers& a, const Numbers& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0;
}

/// The work of every caller, by itself and at once with the others.
void check_at_once(const std::function<Numbers(std::size_t)>& work) {
    const std::vector<Numbers> together = tests::at_once<Numbers>(callers, work);
    for (std::size_t k = 0; k < callers; ++k) {
        CAPTURE(k);
        const Numbers alone = work(k);
        CHECK(alone.size() > 3);
        CHECK(same(together[k], alone));
    }
    CHECK_FALSE(same(together[0], together[1]));  // the callers ask for different things
}

/// A Duffing oscillator as text: interpreted, with what is interpreted in a variable of the thread.
std::shared_ptr<const models::System> written_oscillator(double damping) {
    models::EquationText text;
    text.coordinates = {{"x", "v"}, {"v", "-delta * v - x^3 + gamma * cos(tau)"}};
    text.parameters = {
        {.name = "delta", .value = damping}, {.name = "gamma", .value = 0.3}, {.name = "omega", .value = 1.0}};
    text.forcing = models::EquationText::Forcing{"tau", "omega"};
    std::vector<models::EquationProblem> problems;
    const auto system = models::system_from_text(text, problems);
    if (!system) throw std::logic_error("the oscillator is refused: " + problems.front().rule);
    return system;
}

}  // namespace

TEST_CASE("flows of a shared system by several callers", "[threads][concurrent]") {
    const auto pendulum = models::make_system("parametric_pendulum");
    const Eigen::VectorXd theta = pendulum->default_parameters();
    const std::vector<double> durations{0.2, 0.9};
    const std::vector<Eigen::Index> free{0, 2};
    check_at_once([&](std::size_t k) {
        constexpr Eigen::Index count = 40;  // more than one pack and more than one block of them
        Eigen::MatrixXd starts(2, count);
        for (Eigen::Index i = 0; i < count; ++i)
            starts.col(i) << 0.1 * static_cast<double>(i) - 2.0, 3.0 + static_cast<double>(k);
        const std::vector<double> phases(static_cast<std::size_t>(count), 0.0);
        Numbers numbers;
        for (const auto& flow : pendulum->flows(starts, phases, durations, theta, free, models::Clock::phase)) {
            append(numbers, flow.states);
            append(numbers, flow.sensitivities);
        }
        return numbers;
    });
}

TEST_CASE("models are looked up and equations interpreted by several callers", "[threads][concurrent]") {
    const auto shared = written_oscillator(0.2);
    check_at_once([&](std::size_t k) {
        const auto own = written_oscillator(0.1 + 0.05 * static_cast<double>(k));
        const auto lorenz = models::make_system("lorenz");
        const std::vector<double> durations{0.5, 2.0};
        Numbers numbers;
        for (const auto* system : {shared.get(), own.get()}) {
            const std::vector<Eigen::Index> free{0};
            const auto flow =
                system->flow_with_sensitivities(Eigen::Vector2d(0.3 + 0.1 * static_cast<double>(k), 0.0), 0.0,
                                                durations, system->default_parameters(), free, models::Clock::time);
            append(numbers, flow.states);
            append(numbers, flow.sensitivities);
        }
        const auto flow = lorenz->flow(Eigen::Vector3d(1.0, 1.0 + static_cast<double>(k), 20.0), 0.0, durations,
                                       lorenz->default_parameters(), models::Clock::time);
        append(numbers, flow.states);
        return numbers;
    });
}

TEST_CASE("periodic orbits of a shared system by several callers", "[threads][concurrent]") {
    const auto pendulum = models::make_system("parametric_pendulum");
    const std::vector<Eigen::Index> free{0, 1};
    check_at_once([&](std::size_t k) {
        Eigen::VectorXd theta = pendulum->default_parameters();
        theta[0] *= 1.0 + 1e-4 * static_cast<double>(k);
        const auto orbit =
            periodic::solve_multiple_shooting(*pendulum, theta, 0.0, Eigen::Vector2d(2.96, 6.40), {}, free);
        Numbers numbers{orbit.residual, static_cast<double>(orbit.iterations), static_cast<double>(orbit.status)};
        append(numbers, orbit.points);
        append(numbers, orbit.sensitivities);
        for (const auto& multiplier : orbit.multipliers)
            numbers.insert(numbers.end(), {multiplier.real(), multiplier.imag()});
        return numbers;
    });
}

TEST_CASE("searches for cycles in a shared series by several callers", "[threads][concurrent]") {
    const auto series = tests::henon_series(1 << 12);
    check_at_once([&](std::size_t k) {
        orbits::CycleSearchOptions options;
        options.periods = {1, 2, 4};
        options.order = k % 2 == 0 ? 0 : 3;
        const auto search = find_cycles(series, options);
        Numbers numbers{static_cast<double>(search.candidates), static_cast<double>(search.rejected)};
        for (const auto& cycle : search.cycles) {
            append(numbers, cycle.points);
            append(numbers, cycle.covariance);
        }
        return numbers;
    });
}

TEST_CASE("estimates from a shared series by several callers", "[threads][concurrent]") {
    // Free oscillations of a Duffing oscillator without forcing, one initial state per segment.
    const auto system = written_oscillator(0.2);
    orbits::Series series;
    series.sampling = orbits::Series::Sampling::samples;
    series.coordinates = {{"x", "", false}, {"v", "", false}};
    std::vector<double> times;
    for (int i = 0; i < 60; ++i)
        times.push_back(0.1 * (i + 1));
    for (int s = 0; s < 3; ++s) {
        const auto flow = system->flow(Eigen::Vector2d(0.5 + 0.3 * s, 0.1), 0.0, times, system->default_parameters(),
                                       models::Clock::time);
        orbits::Segment segment;
        segment.label = std::to_string(s);
        segment.values = flow.states;
        // A deterministic ripple takes the place of noise.
        for (Eigen::Index i = 0; i < segment.values.size(); ++i)
            segment.values.data()[i] += 1e-3 * std::sin(7.0 * static_cast<double>(i));
        segment.times = Eigen::Map<const Eigen::VectorXd>(times.data(), std::ssize(times));
        series.segments.push_back(std::move(segment));
    }
    check_at_once([&](std::size_t k) {
        models::ParameterBinding binding;
        binding.base = system->default_parameters();
        binding.parameter = binding.estimated = {0, 1};
        binding.estimated_count = 2;
        orbits::SeriesResidual residual(system, binding, series, {});
        std::vector<estimator::FreeParameter> parameters(2);
        parameters[0].name = "delta";
        parameters[0].start = 0.15 + 0.02 * static_cast<double>(k);
        parameters[1].name = "gamma";
        parameters[1].start = 0.25;
        const auto estimate = estimator::estimate(parameters, {&residual});
        Numbers numbers{estimate.objective, parameters[0].start, static_cast<double>(estimate.status)};
        for (const auto& parameter : estimate.parameters)
            numbers.insert(numbers.end(), {parameter.value, parameter.sd});
        append(numbers, estimate.covariance);
        return numbers;
    });
}

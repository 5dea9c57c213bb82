// Searches for cycles and invariants that are asked to stop.

#include <atomic>

#include "models/system/stopped.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/invariants/correlation_dimension.hpp"
#include "orbits/invariants/lyapunov_spectrum.hpp"
#include "tests/catch.hpp"

namespace stopped_search_test {

using namespace orbid;
using Method = orbits::CycleSearchOptions::Method;

namespace {

orbits::Series henon_series(Eigen::Index points) {
    orbits::Series series;
    series.coordinates = {{"x", "1", false}, {"y", "1", false}};
    series.segments.resize(1);
    series.segments[0].label = "0";
    series.segments[0].values.resize(2, points);
    double x = 0.1, y = 0.1;
    for (Eigen::Index k = -100; k < points; ++k) {
        if (k >= 0) series.segments[0].values.col(k) << x, y;
        const double next = 1.0 - 1.4 * x * x + y;
        y = 0.3 * x;
        x = next;
    }
    return series;
}

}  // namespace

TEST_CASE("a search is left wherever it is asked to stop", "[orbits][stop]") {
    const orbits::Series series = henon_series(3000);
    for (const Method method : {Method::automatic, Method::local_maps, Method::spline_map, Method::closest_return}) {
        CAPTURE(static_cast<int>(method));
        orbits::CycleSearchOptions options;
        options.method = method;
        options.periods = {1, 2, 4};
        std::atomic<long> times{0};
        options.interrupted = [&times] { return ++times < 0; };
        const orbits::CycleSearch whole = orbits::find_cycles(series, options);
        options.interrupted = {};
        CHECK(whole.cycles.size() == orbits::find_cycles(series, options).cycles.size());
        const long all = times;
        REQUIRE(all > 100);
        for (const double part : {0.0, 0.1, 0.5, 0.9}) {
            CAPTURE(part);
            times = 0;
            options.interrupted = [&times, most = static_cast<long>(part * static_cast<double>(all))] {
                return ++times > most;
            };
            CHECK_THROWS_AS(orbits::find_cycles(series, options), models::Stopped);
        }
    }
}

TEST_CASE("invariants are left when they are asked to stop", "[orbits][stop]") {
    const orbits::Series series = henon_series(3000);
    std::atomic<int> times{0};
    const std::function<bool()> soon = [&times] { return ++times > 50; };
    orbits::LyapunovOptions lyapunov;
    lyapunov.interrupted = soon;
    CHECK_THROWS_AS(orbits::lyapunov_spectrum(series, lyapunov), models::Stopped);
    times = 0;
    orbits::CorrelationOptions correlation;
    correlation.interrupted = soon;
    CHECK_THROWS_AS(orbits::correlation_dimension(series, correlation), models::Stopped);
}

}  // namespace stopped_search_test

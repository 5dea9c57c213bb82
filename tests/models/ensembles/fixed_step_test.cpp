#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numeric>
#include <vector>

#include "models/catalogue/driven_pendulum.hpp"
#include "models/catalogue/duffing.hpp"
#include "models/catalogue/henon.hpp"
#include "models/catalogue/ikeda.hpp"
#include "models/catalogue/landing_gear_damper.hpp"
#include "models/catalogue/parametric_pendulum.hpp"
#include "models/ensembles/map_ensemble.hpp"
#include "models/ensembles/section_ensemble.hpp"
#include "tests/catch.hpp"
#include "tests/models/trajectories/extended_flow.hpp"

namespace orbid::models::fixed_step_test {

namespace {

using Crank = PendulumOn<Support::crank>;

template <class M>
Values<double, parameter_count_of<M>> defaults() {
    Values<double, parameter_count_of<M>> p;
    for (std::size_t i = 0; i < p.size(); ++i)
        p[i] = M::parameters[i].default_value;
    return p;
}

struct Ensemble {
    std::vector<std::vector<double>> sections;
    std::vector<std::size_t> columns;
    std::vector<FlowStatus> status;
};

/// In blocks of a size.
template <class Sections>
Ensemble simulate(const Sections& ensemble, const std::vector<double>& starts, std::size_t periods, std::size_t block) {
    const std::size_t count = starts.size() / 2;
    Ensemble result;
    result.sections.assign(count, std::vector<double>(2 * (periods + 1)));
    result.columns.resize(count);
    result.status.resize(count);
    std::vector<double*> pointers;
    for (auto& sections : result.sections)
        pointers.push_back(sections.data());
    for (std::size_t i = 0; i < count; i += block)
        ensemble.advance(&starts[2 * i], std::min(block, count - i), periods, &pointers[i], &result.columns[i],
                         &result.status[i]);
    return result;
}

std::vector<double> spread_starts(std::size_t count, double fastest) {
    std::vector<double> starts;
    for (std::size_t i = 0; i < count; ++i) {
        starts.push_back(std::remainder(0.3 + 2.4 * static_cast<double>(i), 6.283));
        starts.push_back(std::fmod(1.3 + 3.7 * static_cast<double>(i), fastest));
    }
    return starts;
}

/// Root of the mean square error after one period with a number of steps, all of them accepted.
template <class M>
double error_with(std::size_t steps, const Values<double, parameter_count_of<M>>& p,
                  const std::vector<double>& starts) {
    const ExtendedFlow<M> exact(p);
    const auto result = simulate(SectionEnsemble<M>(p, 0.0, FlowOptions{1e-2, 1e-2}, steps), starts, 1, starts.size());
    double sum = 0.0;
    for (std::size_t i = 0; i < result.sections.size(); ++i) {
        REQUIRE(result.status[i] == FlowStatus::ok);
        const double error = distance_to<M>(&result.sections[i][2], exact.period({starts[2 * i], starts[2 * i + 1]}));
        sum += error * error;
    }
    return std::sqrt(sum / static_cast<double>(result.sections.size()));
}

/// A pendulum whose leading error term leads already at these steps: with the defaults the term of order 10 is larger
/// than that of order 9 down to errors of 1e-12, and the observed order falls from 10 to 9.1.
Values<double, 9> slow_pendulum(double k1) {
    auto p = defaults<Crank>();
    p[2] = k1;
    p[3] = 0.000505;
    p[4] = 0.00141;
    p[6] = 0.0573;
    p[7] = 4.2746;
    p[8] = 0.353;
    return p;
}

}  // namespace

TEST_CASE("fixed steps have order nine across velocity zeros", "[models][ensemble]") {
    // k3 > 0: the second derivative jumps at each zero of the velocity; k1 > 0: the first.
    const double k1 = GENERATE(0.0, 1e-3);
    CAPTURE(k1);
    const auto starts = spread_starts(6, 13.932);
    const std::array<std::size_t, 4> steps{16, 20, 24, 32};
    std::array<double, 4> errors;
    for (std::size_t i = 0; i < steps.size(); ++i)
        errors[i] = error_with<Crank>(steps[i], slow_pendulum(k1), starts);
    for (std::size_t i = 0; i + 1 < steps.size(); ++i) {
        const double order = std::log(errors[i] / errors[i + 1]) /
                             std::log(static_cast<double>(steps[i + 1]) / static_cast<double>(steps[i]));
        CAPTURE(steps[i], errors[i], errors[i + 1]);
        CHECK(errors[i + 1] > 1e-12);
        // Largest distance measured: 0.12.
        CHECK_THAT(order, tests::WithinAbs(9.0, 0.2));
    }
}

namespace {

/// Median and largest error over one period from points of the attractor, in units of the tolerance.
template <class M>
std::array<double, 2> errors_on_attractor(const Values<double, parameter_count_of<M>>& p, double tolerance) {
    const SectionEnsemble<M> ensemble(p, 0.0, FlowOptions{tolerance, tolerance});
    constexpr std::size_t count = 40, transient = 50;
    const auto history = simulate(ensemble, spread_starts(count, 3.0), transient, count);
    std::vector<double> points;
    for (const auto& sections : history.sections)
        points.insert(points.end(), sections.end() - 2, sections.end());
    const auto images = simulate(ensemble, points, 1, count);
    const ExtendedFlow<M> exact(p);
    std::vector<double> errors;
    for (std::size_t i = 0; i < count; ++i) {
        REQUIRE(images.status[i] == FlowStatus::ok);
        errors.push_back(distance_to<M>(&images.sections[i][2], exact.period({points[2 * i], points[2 * i + 1]})));
    }
    std::sort(errors.begin(), errors.end());
    return {errors[count / 2] / tolerance, errors.back() / tolerance};
}

}  // namespace

TEST_CASE("sections in packs agree with long double to the tolerance", "[models][ensemble]") {
    // Bounds: measured times ten, in units of the tolerance. A period multiplies errors of steps by up to hundreds;
    // with friction, some of the solutions stick and the side of a release is as sharp as any other event.
    const double tolerance = GENERATE(1e-9, 1e-11, 1e-13);
    CAPTURE(tolerance);
    const auto driven = errors_on_attractor<DrivenPendulum>(defaults<DrivenPendulum>(), tolerance);
    CHECK(driven[0] < 10.0 * 0.77);
    CHECK(driven[1] < 10.0 * 60.0);
    for (const double k1 : {0.0, 1e-3}) {
        CAPTURE(k1);
        auto p = defaults<Crank>();
        p[2] = k1;
        const auto parametric = errors_on_attractor<Crank>(p, tolerance);
        CHECK(parametric[0] < 10.0 * 0.1);
        CHECK(parametric[1] < 10.0 * 2.0);
    }
    const auto strut = errors_on_attractor<StrutOnHarmonicBase>(defaults<StrutOnHarmonicBase>(), tolerance);
    CHECK(strut[1] < 10.0 * 2.0);
    const auto duffing = errors_on_attractor<Duffing>(defaults<Duffing>(), tolerance);
    CHECK(duffing[1] < 10.0 * 20.0);
}

namespace {

template <class M>
void check_blocks(const Values<double, parameter_count_of<M>>& p, const FlowOptions& options, double fastest) {
    constexpr std::size_t count = 100, periods = 30;
    auto starts = spread_starts(count, fastest);
    starts[15] = 0.0;  // one begins on the switching surface
    const SectionEnsemble<M> ensemble(p, 0.4, options);
    const auto together = simulate(ensemble, starts, periods, count);
    const auto same = [&](const Ensemble& other, std::size_t i, std::size_t j) {
        return together.columns[i] == other.columns[j] && together.status[i] == other.status[j] &&
               std::memcmp(together.sections[i].data(), other.sections[j].data(),
                           2 * sizeof(double) * together.columns[i]) == 0;
    };
    for (const std::size_t block : {1, 3, 16}) {
        CAPTURE(block);
        const auto parts = simulate(ensemble, starts, periods, block);
        for (std::size_t i = 0; i < count; ++i)
            CHECK(same(parts, i, i));
    }
    // In another order: 37 has no factor in common with 100.
    std::vector<double> shuffled;
    for (std::size_t j = 0; j < count; ++j)
        shuffled.insert(shuffled.end(), {starts[2 * (37 * j % count)], starts[2 * (37 * j % count) + 1]});
    const auto other = simulate(ensemble, shuffled, periods, count);
    for (std::size_t j = 0; j < count; ++j)
        CHECK(same(other, 37 * j % count, j));
}

}  // namespace

TEST_CASE("a trajectory is the same whatever block it is in", "[models][ensemble]") {
    auto p = defaults<Crank>();
    check_blocks<Crank>(p, FlowOptions{1e-9, 1e-9}, 8.0);
    p[2] = 1e-3;
    check_blocks<Crank>(p, FlowOptions{1e-9, 1e-9}, 8.0);
    // So few steps that trajectories end at different sections.
    check_blocks<Crank>(p, FlowOptions{1e-9, 1e-9, 20}, 8.0);
    check_blocks<DrivenPendulum>(defaults<DrivenPendulum>(), FlowOptions{1e-11, 1e-11}, 3.0);
    check_blocks<StrutOnHarmonicBase>(defaults<StrutOnHarmonicBase>(), FlowOptions{1e-9, 1e-9}, 1.0);
}

TEST_CASE("a budget of steps holds for each period and each trajectory", "[models][ensemble]") {
    const auto p = defaults<DrivenPendulum>();
    const auto starts = spread_starts(40, 3.0);
    // At a tolerance that every step keeps the table's steps are all there are.
    const SectionEnsemble<DrivenPendulum> enough(p, 0.0, FlowOptions{1e-2, 1e-2, 30}, 30);
    const auto whole = simulate(enough, starts, 3, 40);
    CHECK(std::all_of(whole.status.begin(), whole.status.end(), [](FlowStatus s) { return s == FlowStatus::ok; }));
    CHECK(std::all_of(whole.columns.begin(), whole.columns.end(), [](std::size_t c) { return c == 4; }));
    const SectionEnsemble<DrivenPendulum> short_of_one(p, 0.0, FlowOptions{1e-2, 1e-2, 29}, 30);
    const auto none = simulate(short_of_one, starts, 3, 40);
    CHECK(
        std::all_of(none.status.begin(), none.status.end(), [](FlowStatus s) { return s == FlowStatus::step_budget; }));
    CHECK(std::all_of(none.columns.begin(), none.columns.end(), [](std::size_t c) { return c == 1; }));
    // Where many steps are halved the budget of a table's steps runs out for some.
    const SectionEnsemble<DrivenPendulum> coarse(p, 0.0, FlowOptions{1e-10, 1e-10, 40}, 30);
    const auto some = simulate(coarse, starts, 1, 40);
    const auto ended = std::count(some.status.begin(), some.status.end(), FlowStatus::step_budget);
    CHECK(ended > 0);
    CHECK(ended < 40);
}

TEST_CASE("what is not finite ends one trajectory and no other", "[models][ensemble]") {
    // A strut that starts compressed beyond the volume of its gas has no real pressure.
    const auto p = defaults<StrutOnHarmonicBase>();
    std::vector<double> starts = spread_starts(20, 0.5);
    for (std::size_t i = 0; i < 20; ++i)
        starts[2 * i] = 0.1;
    starts[10] = 0.21;
    const auto result = simulate(SectionEnsemble<StrutOnHarmonicBase>(p, 0.0, FlowOptions{1e-9, 1e-9}), starts, 5, 20);
    for (std::size_t i = 0; i < 20; ++i) {
        CAPTURE(i);
        CHECK(result.status[i] == (i == 5 ? FlowStatus::not_finite : FlowStatus::ok));
        CHECK(result.columns[i] == (i == 5 ? 1 : 6));
    }
}

TEST_CASE("friction that the forcing cannot overcome holds a trajectory in a pack", "[models][ensemble]") {
    // phi = 0 at rest: P sin(phi) = 0 is below k1 at every phase. Its neighbours swing.
    auto p = defaults<Crank>();
    p[2] = 1e-2;
    auto starts = spread_starts(9, 8.0);
    starts[8] = 0.0;
    starts[9] = 0.0;
    const auto result = simulate(SectionEnsemble<Crank>(p, 0.0, FlowOptions{1e-9, 1e-9}), starts, 10, 9);
    CHECK(result.status[4] == FlowStatus::ok);
    CHECK(result.sections[4] == std::vector<double>(22, 0.0));
    CHECK(std::abs(result.sections[3][21]) > 1e-3);
}

namespace {

/// Fast and slow in turn: steps of a table that is far too coarse must be refined until they are not.
struct Relaxation {
    static constexpr std::array coordinates{real("x", "1"), real("y", "1")};
    static constexpr std::array parameters{Parameter{"mu", "1/s", positive, 20.0, "damping"},
                                           Parameter{"omega", "rad/s", positive, 0.3, "frequency"}};
    static constexpr std::size_t forcing_frequency = 1;
    template <class T>
    static State<T, 2> rhs(const T& phase, const State<T, 2>& x, const Values<T, 2>& p) {
        using std::cos;
        return {x[1], p[0] * (1.0 - x[0] * x[0]) * x[1] - x[0] + cos(phase)};
    }
};
static_assert(PackModel<Relaxation> && !TabulatedModel<Relaxation>);

/// Says that it branches on its scalar.
struct Branching : Relaxation {
    static constexpr bool packs = false;
};
static_assert(ForcedModel<Branching> && !PackModel<Branching>);

}  // namespace

TEST_CASE("tables that are too coarse are refined", "[models][ensemble]") {
    // The same model in packs and one trajectory at a time; contraction makes both forget their errors.
    const auto starts = spread_starts(20, 2.0);
    const FlowOptions options{1e-9, 1e-9};
    const auto packed = simulate(SectionEnsemble<Relaxation>(defaults<Relaxation>(), 0.0, options), starts, 4, 20);
    const auto single = simulate(SectionEnsemble<Branching>(defaults<Relaxation>(), 0.0, options), starts, 4, 20);
    for (std::size_t i = 0; i < 20; ++i) {
        REQUIRE(packed.status[i] == FlowStatus::ok);
        REQUIRE(single.status[i] == FlowStatus::ok);
        for (std::size_t k = 2; k < 10; ++k)
            CHECK_THAT(packed.sections[i][k], tests::WithinAbs(single.sections[i][k], 1e-7));
    }
}

TEST_CASE("maps are iterated in packs as in double", "[models][ensemble]") {
    // Products and sums are rounded alike: the same bytes. Point 4 leaves the range of numbers at once, points far from
    // the attractor after some iterations.
    constexpr std::size_t count = 40, iterations = 200;
    auto starts = spread_starts(count, 1.4);
    starts[8] = 1e200;
    const auto p = defaults<Henon>();
    const MapEnsemble<Henon> henon(p);
    const auto together = simulate(henon, starts, iterations, count);
    std::size_t escaped = 0;
    for (std::size_t i = 0; i < count; ++i) {
        CAPTURE(i);
        State<double, 2> x{starts[2 * i], starts[2 * i + 1]};
        for (std::size_t k = 1; k < together.columns[i]; ++k) {
            x = Henon::map(x, p);
            REQUIRE(std::memcmp(x.data(), &together.sections[i][2 * k], sizeof x) == 0);
        }
        if (together.columns[i] == iterations + 1) {
            CHECK(together.status[i] == FlowStatus::ok);
        } else {
            ++escaped;
            x = Henon::map(x, p);
            CHECK(!(std::isfinite(x[0]) && std::isfinite(x[1])));
            CHECK(together.status[i] == FlowStatus::not_finite);
        }
    }
    CHECK(together.columns[4] == 1);
    CHECK(escaped > 1);
    CHECK(escaped < count);
    const auto alone = simulate(henon, starts, iterations, 1);
    CHECK(together.columns == alone.columns);
    CHECK(together.status == alone.status);

    // Sines of packs differ from those of the library in the last place: compare single iterations, and blocks.
    const MapEnsemble<Ikeda> ikeda(defaults<Ikeda>());
    const auto turns = spread_starts(count, 1.4);
    const auto light = simulate(ikeda, turns, iterations, count);
    for (std::size_t i = 0; i < count; ++i) {
        const State<double, 2> image = Ikeda::map(State<double, 2>{turns[2 * i], turns[2 * i + 1]}, defaults<Ikeda>());
        CHECK_THAT(light.sections[i][2], tests::WithinAbs(image[0], 1e-14));
        CHECK_THAT(light.sections[i][3], tests::WithinAbs(image[1], 1e-14));
    }
    CHECK(simulate(ikeda, turns, iterations, 7).sections == light.sections);
}

}  // namespace orbid::models::fixed_step_test

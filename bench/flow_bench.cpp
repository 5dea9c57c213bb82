// One period of forced pendulums: time against error.
//
// 2000 points of the attractor are taken over one period by Boost.Odeint's error-controlled rkf78 and dopri5 and by
// System::ensemble, on one core, and compared with the same period in long double. At the end of each table the peer at
// its loosest tolerance with a median error of at most 1e-11 is set against ours at no larger error.
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/info.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <limits>
#include <numbers>
#include <optional>
#include <vector>

#include "bench/odeint_loop.hpp"
#include "bench/ratio.hpp"
#include "models/catalogue/registry.hpp"
#include "models/trajectories/odeint/odeint_kernel.hpp"

namespace {

using namespace orbid;
using bench::Method;
using bench::Pendulum;
using bench::Point;

constexpr std::size_t points = 2000;
/// Median error at which methods are compared.
constexpr double wanted = 1e-11;

struct Case {
    const char* title;
    Pendulum pendulum;
    double k1;
    std::shared_ptr<const models::System> system;
    Eigen::VectorXd theta;
};

struct Row {
    double tolerance, median, most, largest, microseconds;
};

double processor_seconds_of(const auto& work) {
    // The smallest of three: the machine may be shared.
    double least = std::numeric_limits<double>::infinity();
    for (int i = 0; i < 3; ++i) {
        const std::clock_t start = std::clock();
        work();
        least = std::min(least, static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
    }
    return least;
}

double wall_seconds_of(const auto& work) {
    double least = std::numeric_limits<double>::infinity();
    for (int i = 0; i < 3; ++i) {
        const auto start = std::chrono::steady_clock::now();
        work();
        least = std::min(least, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    }
    return least;
}

/// Points of the attractor: 500 trajectories after 100 periods, four times.
Eigen::MatrixXd attractor(const Case& c) {
    Eigen::MatrixXd starts(2, points / 4);
    for (Eigen::Index i = 0; i < starts.cols(); ++i)
        starts.col(i) << models::wrapped(0.3 + 2.4 * static_cast<double>(i)),
            std::fmod(0.3 + 0.37 * static_cast<double>(i), 3.0);
    const auto history = c.system->ensemble(starts, 0.0, 130, c.theta, {1e-12, 1e-12});
    Eigen::MatrixXd result(2, points);
    for (Eigen::Index i = 0; i < starts.cols(); ++i)
        for (Eigen::Index k = 0; k < 4; ++k)
            result.col(4 * i + k) = history.sections[static_cast<std::size_t>(i)].col(100 + 10 * k);
    return result;
}

Row row(double tolerance, double seconds, const std::vector<Point>& images,
        const std::vector<std::array<long double, 2>>& exact) {
    std::vector<double> errors;
    for (std::size_t i = 0; i < images.size(); ++i)
        errors.push_back(static_cast<double>(
            std::hypot(std::remainder(images[i][0] - exact[i][0], 2.0L * std::numbers::pi_v<long double>),
                       images[i][1] - exact[i][1])));
    std::sort(errors.begin(), errors.end());
    const Row r{tolerance, errors[errors.size() / 2], errors[errors.size() * 99 / 100], errors.back(),
                seconds / static_cast<double>(images.size()) * 1e6};
    std::printf("  %8.1e   %8.1e %8.1e %8.1e   %7.2f\n", r.tolerance, r.median, r.most, r.largest, r.microseconds);
    return r;
}

Row ours(const Case& c, double tolerance, const Eigen::MatrixXd& starts,
         const std::vector<std::array<long double, 2>>& exact) {
    // Eight periods, so that what is done once for a call is spread as in a simulation; the first is compared.
    constexpr std::size_t periods = 8;
    models::EnsembleResult result;
    const double seconds = processor_seconds_of([&] {
        result = c.system->ensemble(starts, 0.0, periods, c.theta, {tolerance, tolerance});
    });
    std::vector<Point> images;
    for (const auto& sections : result.sections)
        images.push_back({sections(0, 1), sections(1, 1)});
    return row(tolerance, seconds / periods, images, exact);
}

Row peer(const Case& c, Method method, double tolerance, const std::vector<Point>& starts,
         const std::vector<std::array<long double, 2>>& exact) {
    std::vector<Point> images;
    std::size_t abandoned = 0;
    const double seconds = processor_seconds_of([&] {
        abandoned = 0;
        images = bench::images_by_odeint(c.pendulum, c.k1, method, tolerance, starts, abandoned);
    });
    const Row r = row(tolerance, seconds, images, exact);
    if (abandoned > 0) std::printf("             (%zu points given up after 20000 steps)\n", abandoned);
    return r;
}

/// The loosest of tolerances, four per decade, at which the median error is small enough.
std::optional<Row> loosest(const auto& run, double error) {
    for (int quarter = 32; quarter <= 60; ++quarter) {
        const Row r = run(std::pow(10.0, -0.25 * quarter));
        if (r.median <= error) return r;
    }
    return std::nullopt;
}

void compare(const Case& c) {
    std::printf("%s\n\n", c.title);
    Eigen::MatrixXd starts = attractor(c);
    std::vector<Point> plain;
    for (Eigen::Index i = 0; i < starts.cols(); ++i)
        plain.push_back({starts(0, i), starts(1, i)});
    const auto exact = bench::exact_images(c.pendulum, c.k1, plain);
    const oneapi::tbb::global_control one(oneapi::tbb::global_control::max_allowed_parallelism, 1);
    const char* head = "  tolerance    median     99 %%  largest   us per period\n";
    std::printf("Boost.Odeint rkf78\n");
    std::fputs(head, stdout);
    std::optional<Row> best_peer;
    if (c.k1 > 0.0) {
        // Dry friction defeats it; two tolerances show how.
        for (const double tolerance : {1e-8, 1e-10})
            peer(c, Method::rkf78, tolerance, plain, exact);
    } else {
        for (const double tolerance : {2e-8, 2e-11, 1e-13})
            peer(c, Method::rkf78, tolerance, plain, exact);
        std::printf("  ... loosest tolerance with a median of %.0e\n", wanted);
        best_peer = loosest([&](double t) { return peer(c, Method::rkf78, t, plain, exact); }, wanted);
        std::printf("Boost.Odeint dopri5\n");
        std::fputs(head, stdout);
        for (const double tolerance : {1e-10, 1e-12, 1e-13})
            peer(c, Method::dopri5, tolerance, plain, exact);
    }
    std::printf("orbid\n");
    std::fputs(head, stdout);
    for (const double tolerance : {1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 1e-13})
        ours(c, tolerance, starts, exact);
    if (best_peer) {
        std::printf("  ... loosest tolerance with a median of %.1e\n", best_peer->median);
        const auto best = loosest([&](double t) { return ours(c, t, starts, exact); }, best_peer->median);
        if (best)
            bench::print_ratio(std::string(c.title) + ": a period in blocks, equal error", "Boost.Odeint rkf78",
                               best->microseconds, best_peer->microseconds, "us");
    }
    std::printf("\n");
}

/// What few trajectories cost, against one flow after the other.
void few(const Case& c) {
    constexpr double tolerance = 1e-11;
    const oneapi::tbb::global_control one(oneapi::tbb::global_control::max_allowed_parallelism, 1);
    const Eigen::MatrixXd all = attractor(c);
    const std::array<double, 1> period{2.0 * std::numbers::pi};
    const double single = processor_seconds_of([&] {
        for (Eigen::Index i = 0; i < 500; ++i)
            if (c.system->flow(all.col(i), 0.0, period, c.theta, models::Clock::phase, {tolerance, tolerance}).status !=
                models::FlowStatus::ok)
                std::printf("a flow failed\n");
    });
    std::printf("%s, tolerance %.0e: flow %.2f us per period; ensemble of", c.title, tolerance, single / 500 * 1e6);
    for (const Eigen::Index count : {1, 4, 16, 64, 256}) {
        constexpr std::size_t periods = 200;
        const Eigen::MatrixXd starts = all.leftCols(count);
        const double seconds = processor_seconds_of([&] {
            static_cast<void>(c.system->ensemble(starts, 0.0, periods, c.theta, {tolerance, tolerance}));
        });
        std::printf(" %d: %.2f", static_cast<int>(count),
                    seconds / static_cast<double>(count * static_cast<Eigen::Index>(periods)) * 1e6);
    }
    std::printf("\n");
}

/// What a job pays that has its flows computed by Boost.Odeint: one period with all first derivatives.
void by_both_steppers(const Case& c) {
    if (!c.system->smooth(c.theta)) return;
    const auto other = models::odeint_system(*c.system);
    const Eigen::MatrixXd starts = attractor(c).leftCols(100);
    const std::array<double, 1> period{2.0 * std::numbers::pi};
    std::vector<Eigen::Index> free;
    for (Eigen::Index i = 0; i < c.theta.size(); ++i) {
        // The derivative by a dry friction jumps, also where there is none.
        Eigen::VectorXd moved = c.theta;
        moved[i] += c.system->parameters()[static_cast<std::size_t>(i)].typical_size;
        if (c.system->smooth(moved)) free.push_back(i);
    }
    std::printf("%s, flow_with_sensitivities, us per period (own, odeint, ratio):", c.title);
    std::array<double, 2> last{};
    for (const double tolerance : {1e-8, 1e-10, 1e-11}) {
        const auto cost = [&](const models::System& system) {
            const double seconds = processor_seconds_of([&] {
                for (Eigen::Index i = 0; i < starts.cols(); ++i)
                    static_cast<void>(system.flow_with_sensitivities(starts.col(i), 0.0, period, c.theta, free,
                                                                     models::Clock::phase, {tolerance, tolerance}));
            });
            return seconds / static_cast<double>(starts.cols()) * 1e6;
        };
        const double own = cost(*c.system), peers = cost(*other);
        std::printf(" %.0e: %.1f %.0f %.1f", tolerance, own, peers, peers / own);
        last = {own, peers};
    }
    std::printf("\n");
    bench::print_ratio(std::string(c.title) + ": a period with all derivatives, 1e-11", "Boost.Odeint's steps in orbid",
                       last[0], last[1], "us");
}

/// How much faster all cores are than one, at work that is cut into pieces.
double gain_of_cores(const auto& work) {
    const double all = wall_seconds_of(work);
    const oneapi::tbb::global_control one(oneapi::tbb::global_control::max_allowed_parallelism, 1);
    return wall_seconds_of(work) / all;
}

void on_all_cores(const Case& c) {
    const int cores = oneapi::tbb::info::default_concurrency();
    const Eigen::MatrixXd some = attractor(c);
    Eigen::MatrixXd starts(2, 4 * some.cols());
    starts << some, some, some, some;
    const double gain = gain_of_cores([&] {
        static_cast<void>(c.system->ensemble(starts, 0.0, 20, c.theta, {1e-11, 1e-11}));
    });
    // What the machine gives at this moment to threads that share nothing, square roots in registers: all cores, unless
    // others use them.
    const double machine = gain_of_cores([] {
        oneapi::tbb::parallel_for(0, 32, [](int) {
            volatile double sum = 0.0;
            double z = 0.0;
            for (int i = 0; i < 2000000; ++i)
                z += std::sqrt(z + i);
            sum = z;
        });
    });
    std::printf("%s: %d cores %.2f times as fast as one (%.2f x cores); loops that share nothing: %.2f\n", c.title,
                cores, gain, gain / cores, machine);
    bench::print_ratio(std::string(c.title) + ": blocks on all cores", "loops that share nothing", 1.0 / gain,
                       1.0 / machine, "of one core's time");
}

}  // namespace

int main() {
    std::vector<Case> cases;
    const auto driven = models::make_system("driven_pendulum");
    const auto parametric = models::make_system("parametric_pendulum");
    Eigen::VectorXd rough = parametric->default_parameters();
    rough[parametric->parameter_index("k1")] = 1e-3;
    cases.push_back({"torque-driven pendulum", Pendulum::driven, 0.0, driven, driven->default_parameters()});
    cases.push_back({"parametric pendulum", Pendulum::parametric, 0.0, parametric, parametric->default_parameters()});
    cases.push_back({"parametric pendulum with dry friction", Pendulum::parametric, 1e-3, parametric, rough});
    for (const Case& c : cases)
        compare(c);
    for (const Case& c : cases)
        few(c);
    for (const Case& c : cases)
        by_both_steppers(c);
    for (const Case& c : cases)
        on_all_cores(c);
}

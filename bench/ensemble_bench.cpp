// Sections of the pendulum: System::ensemble against a plain Boost.Odeint loop (runge_kutta_fehlberg78, controlled), at
// equal error per period, same threads, same run. The peer's tolerance is the loosest one (of steps of 10^(1/4)) whose
// median error per period is not above ours; errors are measured against a flow at tolerance 1e-15. Times are those of
// the processor, on one thread, so that other programs disturb the ratio little.
//
//     ensemble_bench --peer-only SECTIONS TRAJECTORIES
//
// runs the plain loop alone, in threads over the trajectories, for that many sections in total, at the tolerance where
// its error equals ours at 1e-12, and prints the seconds it took.
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <boost/numeric/odeint.hpp>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <numbers>
#include <vector>

#include "bench/ratio.hpp"
#include "models/catalogue/registry.hpp"

namespace {

using namespace orbid::models;
namespace odeint = boost::numeric::odeint;
using State2 = std::array<double, 2>;
constexpr double turn = 2.0 * std::numbers::pi;

struct Pendulum {  // as a user would write it, constants reduced beforehand
    double k2, k3, w0, aw, e, omega;
    void operator()(const State2& x, State2& f, double tau) const {
        const double s = std::sin(tau), c = std::cos(tau), root = 1.0 - e * e * s * s;
        const double p = w0 - aw * (c + e * (1.0 - 2.0 * s * s + e * e * s * s * s * s) / (root * std::sqrt(root)));
        f[0] = x[1] / omega;
        f[1] = (-x[1] * (k2 + k3 * std::abs(x[1])) - p * std::sin(x[0])) / omega;
    }
};

Pendulum peer_of(const Eigen::VectorXd& theta) {
    const double inertia = theta[0] * theta[1] * theta[1];
    return {theta[3] / inertia,
            theta[4] / inertia,
            theta[5] / theta[1],
            theta[6] * theta[7] * theta[7] / theta[1],
            theta[8],
            theta[7]};
}

/// Starts all over the section: columns of states.
Eigen::MatrixXd starts_of(std::size_t trajectories) {
    Eigen::MatrixXd starts(2, trajectories);
    for (Eigen::Index i = 0; i < starts.cols(); ++i)
        starts.col(i) << wrapped(0.3 + 2.4 * static_cast<double>(i)),
            std::fmod(1.3 + 3.7 * static_cast<double>(i), 8.0);
    return starts;
}

std::vector<Eigen::MatrixXd> sections_of_peer(const Pendulum& peer, const Eigen::MatrixXd& starts, std::size_t periods,
                                              double tolerance) {
    const auto trajectories = static_cast<std::size_t>(starts.cols());
    std::vector<Eigen::MatrixXd> sections(trajectories);
    oneapi::tbb::parallel_for(std::size_t{0}, trajectories, [&](std::size_t i) {
        const auto column = static_cast<Eigen::Index>(i);
        sections[i].resize(2, static_cast<Eigen::Index>(periods + 1));
        State2 x{starts(0, column), starts(1, column)};
        auto stepper = odeint::make_controlled(tolerance, tolerance, odeint::runge_kutta_fehlberg78<State2>());
        for (std::size_t k = 0;; ++k) {
            sections[i].col(static_cast<Eigen::Index>(k)) << x[0], x[1];
            if (k == periods) break;
            odeint::integrate_adaptive(stepper, peer, x, 0.0, turn, turn / 40.0);
            x[0] = wrapped(x[0]);
        }
    });
    return sections;
}

double processor_seconds_of(const auto& work) {
    const std::clock_t start = std::clock();
    work();
    return static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
}

int run_peer_only(const char* sections_text, const char* trajectories_text) {
    const auto sections = std::strtoull(sections_text, nullptr, 10);
    const auto trajectories = std::strtoull(trajectories_text, nullptr, 10);
    if (trajectories == 0 || sections < trajectories) {
        std::fprintf(stderr, "ensemble_bench: at least one trajectory, and one section for each\n");
        return 2;
    }
    // Median errors per period of the loop: 2.2e-12 at 1e-13, 1.3e-12 at 5.6e-14; ours at 1e-12: 1.7e-12.
    constexpr double tolerance = 7.5e-14;
    const Pendulum peer = peer_of(make_system("parametric_pendulum")->default_parameters());
    const auto start = std::chrono::steady_clock::now();
    sections_of_peer(peer, starts_of(trajectories), sections / trajectories, tolerance);
    std::printf("%.3f\n", std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    return 0;
}

}  // namespace

int main(int count, char** arguments) {
    if (count == 4 && std::strcmp(arguments[1], "--peer-only") == 0) return run_peer_only(arguments[2], arguments[3]);
    if (count != 1) {
        std::fprintf(stderr, "usage: ensemble_bench [--peer-only SECTIONS TRAJECTORIES]\n");
        return 2;
    }
    const auto system = make_system("parametric_pendulum");
    const Eigen::VectorXd theta = system->default_parameters();
    const Pendulum peer = peer_of(theta);
    constexpr std::size_t trajectories = 4, periods = 4000;
    const Eigen::MatrixXd starts = starts_of(trajectories);
    const oneapi::tbb::global_control one(oneapi::tbb::global_control::max_allowed_parallelism, 1);

    const auto median_error = [&](const std::vector<Eigen::MatrixXd>& sections) {
        std::vector<double> errors;
        const std::array<double, 1> period{turn};
        for (const auto& s : sections)
            for (Eigen::Index k = 0; k + 1 < s.cols(); k += 10) {
                Eigen::Vector2d d =
                    system->flow(s.col(k), 0.0, period, theta, Clock::phase, {1e-15, 1e-15}).states.col(0) -
                    s.col(k + 1);
                d[0] = wrapped(d[0]);
                errors.push_back(d.norm());
            }
        std::sort(errors.begin(), errors.end());
        std::printf("    median %.1e, 99 %% %.1e, largest %.1e\n", errors[errors.size() / 2],
                    errors[errors.size() * 99 / 100], errors.back());
        return errors[errors.size() / 2];
    };

    for (const double tolerance : {1e-10, 1e-12, 1e-13}) {
        EnsembleResult ours;
        const double time = processor_seconds_of([&] {
            ours = system->ensemble(starts, 0.0, periods, theta, {tolerance, tolerance});
        });
        std::printf("orbid, tolerance %.0e: %.2f us per period\n", tolerance, time / (trajectories * periods) * 1e6);
        const double error = median_error(ours.sections);
        for (double t = tolerance; t > 1e-16; t *= std::pow(10.0, -0.25)) {
            std::vector<Eigen::MatrixXd> theirs;
            const double peer_time = processor_seconds_of([&] { theirs = sections_of_peer(peer, starts, periods, t); });
            std::printf("  odeint rkf78, tolerance %.0e: %.2f us per period\n", t,
                        peer_time / (trajectories * periods) * 1e6);
            if (!(median_error(theirs) <= error)) continue;
            char task[80];
            std::snprintf(task, sizeof task, "sections of 4 trajectories, tolerance %.0e, equal error", tolerance);
            constexpr double each = 1e6 / (trajectories * periods);
            orbid::bench::print_ratio(task, "Boost.Odeint rkf78", each * time, each * peer_time, "us");
            break;
        }
    }
}

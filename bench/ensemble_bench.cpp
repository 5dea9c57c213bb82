// Sections of the pendulum: System::ensemble against a plain Boost.Odeint loop (runge_kutta_fehlberg78, controlled), at
// equal error per period, same threads, same run. The peer's tolerance is the loosest one (of steps of 10^(1/4)) whose
// median error per period is not above ours; errors are measured against a flow at tolerance 1e-15.
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <boost/numeric/odeint.hpp>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <vector>

#include "models/registry.hpp"

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

double seconds_of(const auto& work) {
    const auto start = std::chrono::steady_clock::now();
    work();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

int main() {
    const auto system = make_system("parametric_pendulum");
    const Eigen::VectorXd theta = system->default_parameters();
    const double inertia = theta[0] * theta[1] * theta[1];
    const Pendulum peer{theta[3] / inertia,
                        theta[4] / inertia,
                        theta[5] / theta[1],
                        theta[6] * theta[7] * theta[7] / theta[1],
                        theta[8],
                        theta[7]};
    constexpr std::size_t trajectories = 4, periods = 4000;
    Eigen::MatrixXd starts(2, trajectories);
    starts << 0.3, -1.0, 2.0, 1.3, 2.0, 5.0, -3.0, 7.0;
    const oneapi::tbb::global_control one(oneapi::tbb::global_control::max_allowed_parallelism, 1);

    const auto sections_of_peer = [&](double tolerance) {
        std::vector<Eigen::MatrixXd> sections(trajectories);
        oneapi::tbb::parallel_for(std::size_t{0}, trajectories, [&](std::size_t i) {
            sections[i].resize(2, periods + 1);
            State2 x{starts(0, i), starts(1, i)};
            auto stepper = odeint::make_controlled(tolerance, tolerance, odeint::runge_kutta_fehlberg78<State2>());
            for (std::size_t k = 0;; ++k) {
                sections[i].col(k) << x[0], x[1];
                if (k == periods) break;
                odeint::integrate_adaptive(stepper, peer, x, 0.0, turn, turn / 40.0);
                x[0] = wrapped(x[0]);
            }
        });
        return sections;
    };
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
        const double time = seconds_of([&] {
            ours = system->ensemble(starts, 0.0, periods, theta, {tolerance, tolerance});
        });
        std::printf("orbid, tolerance %.0e: %.2f us per period\n", tolerance, time / (trajectories * periods) * 1e6);
        const double error = median_error(ours.sections);
        for (double t = tolerance; t > 1e-16; t *= std::pow(10.0, -0.25)) {
            std::vector<Eigen::MatrixXd> theirs;
            const double peer_time = seconds_of([&] { theirs = sections_of_peer(t); });
            std::printf("  odeint rkf78, tolerance %.0e: %.2f us per period\n", t,
                        peer_time / (trajectories * periods) * 1e6);
            if (!(median_error(theirs) <= error)) continue;
            std::printf("  ratio of times, odeint / orbid: %.2f\n", peer_time / time);
            break;
        }
    }
}

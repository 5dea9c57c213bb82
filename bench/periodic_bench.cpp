// Periodic solutions of the pendulums from disturbed points: the share that ends at the right cycle, how the others
// end, errors of the multipliers and the time per orbit, for the three discretisations.
//   periodic_bench [displacement relative to the size of the attractor, default 3e-3] [draws per cycle, default 20]
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <map>
#include <random>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "models/catalogue/registry.hpp"
#include "periodic/solution/collocation.hpp"
#include "periodic/solution/finite_difference.hpp"
#include "periodic/solution/multiple_shooting.hpp"
#include "periodic/stability/stability.hpp"

namespace {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using periodic::OrbitStatus;
using periodic::PeriodicOrbit;

struct Reference {
    MatrixXd points;
    double unstable = 0.0;
    double stable = 0.0;
};

/// Processor time, of all threads: run on one core (taskset -c 0) it is the time per orbit also on a busy machine.
double seconds_since(std::clock_t from) {
    return static_cast<double>(std::clock() - from) / CLOCKS_PER_SEC;
}

nlohmann::json table(const std::string& file) {
    std::ifstream stream(std::string(ORBID_SOURCE_DIR) + "/tests/reference/" + file);
    return nlohmann::json::parse(stream);
}

std::vector<Reference> pendulum_cycles(const models::System& system, const std::string& file, VectorXd& theta) {
    const auto json = table(file);
    for (const auto& [key, value] : json.at("parameters").items())
        theta(system.parameter_index(key)) = value.get<double>();
    std::vector<Reference> cycles;
    for (const auto& entry : json.at("cycles")) {
        Reference cycle{MatrixXd(2, entry.at("period").get<Index>()), entry.at("unstable_multiplier"),
                        entry.at("stable_multiplier")};
        for (Index j = 0; j < cycle.points.cols(); ++j)
            for (Index i = 0; i < 2; ++i)
                cycle.points(i, j) = entry.at("points").at(static_cast<std::size_t>(j)).at(static_cast<std::size_t>(i));
        cycles.push_back(cycle);
    }
    return cycles;
}

double distance(const MatrixXd& a, const MatrixXd& b) {
    double largest = 0.0;
    for (Index j = 0; j < a.cols(); ++j) {
        largest = std::max(largest, std::abs(models::wrapped(a(0, j) - b(0, j))));
        largest = std::max(largest, std::abs(a(1, j) - b(1, j)));
    }
    return largest;
}

std::vector<Reference> driven_cycles(const models::System& system, const VectorXd& theta) {
    std::vector<Reference> cycles;
    const auto json = table("driven_pendulum_orbits.json");
    for (const auto& entry : json.at("cycles")) {
        const auto number = [&](const char* key) { return std::stod(entry.at(key).get<std::string>()); };
        const auto period = entry.at("period").get<std::size_t>();
        const Eigen::Vector2d first(number("theta_0"), number("theta_dot_0"));
        // The other points from the first one, and the errors that grow on the way taken off again.
        periodic::ShootingOptions exact;
        exact.flow.relative_tolerance = exact.flow.absolute_tolerance = 1e-14;
        periodic::StartingSolution start;
        start.points = system.ensemble(first, 0.0, period, theta).sections[0].leftCols(static_cast<Index>(period));
        const PeriodicOrbit orbit = solve_multiple_shooting(system, theta, start, {}, exact);
        if (distance(orbit.points.leftCols(1), first) > 1e-12)
            std::printf("  the first point of a period-%zu cycle is %.1e off the table\n", period,
                        distance(orbit.points.leftCols(1), first));
        cycles.push_back({orbit.points, number("unstable_multiplier"), number("stable_multiplier")});
    }
    return cycles;
}

void run(const char* title, const models::System& system, const VectorXd& theta, const std::vector<Reference>& cycles,
         const Eigen::Vector2d& size, double displacement, int draws) {
    periodic::ShootingOptions options;
    options.scale = size;
    options.flow.relative_tolerance = options.flow.absolute_tolerance = 1e-13;
    // Farther than this from its guess an orbit is another one: four sds.
    options.maximum_distance = 4.0 * displacement;
    std::mt19937_64 generator(1);
    std::normal_distribution<double> normal;
    std::map<std::string, int> ends;
    std::map<Index, int> lost;  // per period
    int right = 0, wrong = 0, all = 0, orbits = 0;
    double unstable_error = 0.0, stable_error = 0.0, time = 0.0;
    long iterations = 0;
    for (const Reference& cycle : cycles) {
        ++orbits;
        for (int draw = 0; draw < draws; ++draw) {
            MatrixXd guess = cycle.points;
            for (Index j = 0; j < guess.cols(); ++j)
                for (Index i = 0; i < 2; ++i)
                    guess(i, j) += displacement * size(i) * normal(generator);
            const auto start = std::clock();
            const PeriodicOrbit orbit = solve_multiple_shooting(system, theta, 0.0, guess, {}, {}, options);
            time += seconds_since(start);
            ++all;
            iterations += orbit.iterations;
            const bool same = orbit.status == OrbitStatus::converged && distance(orbit.points, cycle.points) < 1e-11;
            if (same) {
                ++right;
                unstable_error = std::max(unstable_error, std::abs(orbit.multipliers[0].real() / cycle.unstable - 1.0));
                stable_error = std::max(stable_error, std::abs(orbit.multipliers[1].real() / cycle.stable - 1.0));
            } else if (orbit.status == OrbitStatus::converged) {
                ++lost[cycle.points.cols()];
                ++wrong;
                std::printf("  called converged, %.1e off: period %td multiplier %g, distance %.3g\n",
                            distance(orbit.points, cycle.points), cycle.points.cols(), cycle.unstable, orbit.distance);
            } else {
                ++lost[cycle.points.cols()];
                ++ends[std::string(name(orbit.status))];
            }
        }
    }
    std::printf(
        "%s: %d cycles, %d starts %.0e off: right %.2f %%, wrong but called right %d, time per orbit %.3f ms, "
        "%.1f iterations\n",
        title, orbits, all, displacement, 100.0 * right / all, wrong, 1e3 * time / all,
        static_cast<double>(iterations) / all);
    for (const auto& [end, count] : ends)
        std::printf("  %s %d\n", end.c_str(), count);
    for (const auto& [period, count] : lost)
        std::printf("  not found at period %td: %d\n", period, count);
    std::printf("  largest relative error of the multipliers: unstable %.1e, stable %.1e (as far as the table goes)\n",
                unstable_error, stable_error);
}

void compare(const models::System& system, const VectorXd& theta, const std::vector<Reference>& cycles,
             const Eigen::Vector2d& size, const char* title) {
    std::printf("%s, all cycles, starts 1e-4 off: time per orbit, worst error of points (relative) and multiplier\n",
                title);
    const auto report = [&](const char* method, auto solve) {
        double time = 0.0, point = 0.0, multiplier = 0.0;
        int solved = 0;
        for (const Reference& cycle : cycles) {
            periodic::StartingSolution start;
            start.points = cycle.points.colwise() + 1e-4 * size;
            const auto from = std::clock();
            const PeriodicOrbit orbit = solve(start);
            time += seconds_since(from);
            if (orbit.status != OrbitStatus::converged) continue;
            if (orbit.multipliers.size() != 2) {
                std::printf("  %s: multipliers of a period-%td cycle not found\n", method, cycle.points.cols());
                continue;
            }
            ++solved;
            point = std::max(point, distance(orbit.points, cycle.points) / size.minCoeff());
            multiplier = std::max(multiplier, std::abs(orbit.multipliers[0].real() / cycle.unstable - 1.0));
        }
        std::printf("  %-34s %zu of %zu, %8.3f ms, %.1e, %.1e\n", method, static_cast<std::size_t>(solved),
                    cycles.size(), 1e3 * time / static_cast<double>(cycles.size()), point, multiplier);
    };
    periodic::ShootingOptions solver;
    solver.scale = size;
    for (const double tolerance : {1e-9, 1e-13}) {
        solver.flow.relative_tolerance = solver.flow.absolute_tolerance = tolerance;
        report(tolerance < 1e-12 ? "multiple shooting, flow 1e-13" : "multiple shooting, flow 1e-9",
               [&](const auto& start) { return solve_multiple_shooting(system, theta, start, {}, solver); });
    }
    solver.flow = {};
    for (const int nodes : {100, 400}) {
        periodic::FiniteDifferenceOptions options;
        options.nodes = nodes;
        options.solver = solver;
        options.estimate_error = false;
        report(nodes == 100 ? "finite differences, 100 nodes" : "finite differences, 400 nodes",
               [&](const auto& start) { return solve_finite_difference(system, theta, start, {}, options); });
    }
    for (const int stages : {4, 6}) {
        periodic::CollocationOptions options;
        options.stages = stages;
        options.solver = solver;
        report(stages == 4 ? "collocation, 4 points, 1e-10" : "collocation, 6 points, 1e-10",
               [&](const auto& start) { return solve_collocation(system, theta, start, {}, options); });
    }
}

}  // namespace

int main(int argc, char** argv) {
    const double displacement = argc > 1 ? std::atof(argv[1]) : 3e-3;
    const int draws = argc > 2 ? std::atoi(argv[2]) : 20;
    if (!(displacement > 0.0) || draws < 1) {
        std::fprintf(stderr, "the displacement must be > 0, the draws >= 1\n");
        return 2;
    }
    const Eigen::Vector2d size(6.283185307179586, 29.3);  // of the section
    const auto pendulum = models::make_system("parametric_pendulum");
    for (const char* g : {"g9.81", "g9.8348933"}) {
        VectorXd theta = pendulum->default_parameters();
        const auto cycles = pendulum_cycles(*pendulum, std::string("pendulum_orbits_") + g + ".json", theta);
        run((std::string("pendulum ") + g).c_str(), *pendulum, theta, cycles, size, displacement, draws);
        if (std::string(g) == "g9.81") compare(*pendulum, theta, cycles, size, "pendulum g9.81");
    }
    const auto driven = models::make_system("driven_pendulum");
    const VectorXd theta = driven->default_parameters();
    const Eigen::Vector2d driven_size(6.283185307179586, 4.0);
    const auto cycles = driven_cycles(*driven, theta);
    run("torque-driven pendulum", *driven, theta, cycles, driven_size, displacement, draws);
    compare(*driven, theta, cycles, driven_size, "torque-driven pendulum");
    return 0;
}

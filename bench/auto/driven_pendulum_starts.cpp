// Starts for AUTO-07p and the same orbits by multiple shooting: compare.py runs this program.
//   driven_pendulum_starts FOLDER [displacement relative to the attractor, default 3e-3] [draws per cycle, default 5]
//   [tolerance of the flow, default 1e-13]
// Writes FOLDER/K/start.dat (read by driven_pendulum.f90) for K = 0, 1, ... and prints one line for each:
//   K period unstable stable milliseconds status error-of-points error-of-unstable error-of-stable theta theta_dot
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include <tbb/global_control.h>
#include <nlohmann/json.hpp>

#include "models/catalogue/registry.hpp"
#include "periodic/solution/multiple_shooting.hpp"

namespace {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;

constexpr double full_turn = 2.0 * std::numbers::pi;
constexpr int rows_per_period = 200;

/// The guess as AUTO takes it: the flow of each point over its period. AUTO wants a continuous function: what the flow
/// misses the next point by is taken off along the way.
void write_start(const models::System& system, const Eigen::VectorXd& theta, const MatrixXd& guess, int turns,
                 const std::string& file) {
    const Index p = guess.cols();
    std::vector<double> durations;
    for (int k = 1; k <= rows_per_period; ++k)
        durations.push_back(full_turn * k / rows_per_period);
    std::ofstream out(file);
    out.precision(17);
    out << p << ' ' << turns << ' ' << p * rows_per_period + 1 << '\n';
    out << 0.0 << ' ' << guess(0, 0) << ' ' << guess(1, 0) << '\n';
    double turned = 0.0;
    for (Index j = 0; j < p; ++j) {
        const auto flow = system.flow(guess.col(j), 0.0, durations, theta, models::Clock::phase);
        Eigen::Vector2d next = guess.col((j + 1) % p);
        next(0) += full_turn * std::round((flow.states(0, rows_per_period - 1) - next(0)) / full_turn);
        const Eigen::Vector2d missed = flow.states.col(rows_per_period - 1) - next;
        for (int k = 0; k < rows_per_period; ++k) {
            const double share = (k + 1.0) / rows_per_period;
            const Eigen::Vector2d x = flow.states.col(k) - share * missed;
            out << (static_cast<double>(j) + share) / static_cast<double>(p) << ' ' << x(0) + turned << ' ' << x(1)
                << '\n';
        }
        turned += next(0) - guess(0, (j + 1) % p);
    }
}

}  // namespace

int main(int argc, char** argv) {
    if (argc < 2) {
        std::fprintf(stderr, "usage: driven_pendulum_starts FOLDER [displacement] [draws] [tolerance]\n");
        return 2;
    }
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    const double displacement = argc > 2 ? std::atof(argv[2]) : 3e-3;
    const int draws = argc > 3 ? std::atoi(argv[3]) : 5;
    const double tolerance = argc > 4 ? std::atof(argv[4]) : 1e-13;
    const auto system = models::make_system("driven_pendulum");
    const Eigen::VectorXd theta = system->default_parameters();
    const Eigen::Vector2d size(full_turn, 4.0);
    std::ifstream stream(std::string(ORBID_SOURCE_DIR) + "/tests/reference/driven_pendulum_orbits.json");
    const auto table = nlohmann::json::parse(stream);
    std::mt19937_64 generator(1);
    std::normal_distribution<double> normal;
    int number = 0;
    for (const auto& entry : table.at("cycles")) {
        const auto value = [&](const char* key) { return std::stod(entry.at(key).get<std::string>()); };
        const auto period = entry.at("period").get<std::size_t>();
        if (period > 6) continue;
        const Eigen::Vector2d first(value("theta_0"), value("theta_dot_0"));
        periodic::ShootingOptions options;
        options.flow.relative_tolerance = options.flow.absolute_tolerance = tolerance;
        options.scale = size;
        const MatrixXd points =
            system->ensemble(first, 0.0, period, theta).sections[0].leftCols(static_cast<Index>(period));
        periodic::ShootingOptions fine = options;
        fine.flow.relative_tolerance = fine.flow.absolute_tolerance = 1e-13;
        const auto exact = solve_multiple_shooting(*system, theta, 0.0, points, {}, {}, fine);
        // The table has ten digits of the stable one, the product of both all.
        const double unstable = value("unstable_multiplier");
        const double stable =
            std::exp(-theta(0) * static_cast<double>(period) * system->period(theta, models::Clock::time)) / unstable;
        for (int draw = 0; draw < draws; ++draw) {
            MatrixXd guess = exact.points;
            for (Index j = 0; j < guess.cols(); ++j)
                for (Index i = 0; i < 2; ++i)
                    guess(i, j) += displacement * size(i) * normal(generator);
            // Processor time of the best of five, the same for both sides.
            double best = 1e9;
            periodic::PeriodicOrbit orbit;
            for (int repeat = 0; repeat < 5; ++repeat) {
                const auto from = std::clock();
                orbit = solve_multiple_shooting(*system, theta, 0.0, guess, {}, {}, options);
                best = std::min(best, static_cast<double>(std::clock() - from) / CLOCKS_PER_SEC);
            }
            const std::string folder = std::string(argv[1]) + "/" + std::to_string(number);
            std::filesystem::create_directories(folder);
            write_start(*system, theta, guess, entry.at("rotation").get<int>(), folder + "/start.dat");
            const double nan = std::nan("");
            const bool found = orbit.status == periodic::OrbitStatus::converged;
            std::printf("%d %zu %.15g %.15g %.4f %s %.1e %.1e %.1e %.17g %.17g\n", number, period, unstable, stable,
                        1e3 * best, std::string(name(orbit.status)).c_str(),
                        found ? (orbit.points.col(0) - first).cwiseAbs().maxCoeff() : nan,
                        found ? std::abs(orbit.multipliers[0].real() / unstable - 1.0) : nan,
                        found ? std::abs(orbit.multipliers[1].real() / stable - 1.0) : nan, first(0), first(1));
            ++number;
        }
    }
    return 0;
}

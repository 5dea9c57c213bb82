// The cascade of the parametric pendulum, from the locked rotation at 13 rad/s down: its doublings, what they cost per
// point of a branch, and AUTO-07p on the same branches in the same run (bench/auto/cascade.sh; without AUTO that is
// said, and only our own figures are printed).
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <sstream>
#include <string>
#include <vector>

#include <tbb/global_control.h>

#include "bench/ratio.hpp"
#include "models/catalogue/registry.hpp"
#include "periodic/branches/continuation.hpp"

using namespace orbid;
using Eigen::VectorXd;
using periodic::Bifurcation;

namespace {

constexpr double full_turn = 2.0 * std::numbers::pi;
constexpr int generations = 5;
constexpr int repetitions = 7;

VectorXd after(const models::System& system, const VectorXd& x, double phase, const VectorXd& theta) {
    const double durations[] = {phase};
    return system.flow(x, 0.0, durations, theta, models::Clock::phase).states.col(0);
}

/// One line of the cascade: a branch up to its first doubling.
struct Generation {
    std::size_t points = 0;
    double time = 0.0;  ///< processor time [s]
    double doubling = 0.0;
    double error = 0.0;
};

/// The branches of each period by themselves: a diagram up to this period minus one up to half of it.
std::vector<Generation> cascade(const models::System& system, const VectorXd& theta,
                                const periodic::StartingSolution& start, periodic::ContinuationOptions options) {
    std::vector<Generation> result;
    Generation before;
    for (int g = 0; g < generations; ++g) {
        options.maximum_period = 1 << g;
        Generation total;
        total.time = 1e9;
        periodic::BifurcationDiagram diagram;
        for (int k = 0; k < repetitions; ++k) {
            const std::clock_t begin = std::clock();
            diagram = follow_branches(system, theta, start, options);
            total.time = std::min(total.time, static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC);
        }
        for (const auto& branch : diagram.branches)
            total.points += branch.points.size();
        Generation one{total.points - before.points, total.time - before.time, 0.0, 0.0};
        if (diagram.branches.size() == static_cast<std::size_t>(g + 1))
            for (const auto& point : diagram.branches.back().points)
                if (point.bifurcation == Bifurcation::period_doubling) {
                    one.doubling = point.parameter;
                    one.error = point.parameter_error;
                    break;
                }
        result.push_back(one);
        before = total;
    }
    return result;
}

/// What AUTO says of the same; empty when it is not there.
std::vector<Generation> peer(const models::System& system, const VectorXd& theta, const VectorXd& x, double omega) {
    const auto path = std::filesystem::temp_directory_path() / ("cascade_" + std::to_string(std::rand()) + ".dat");
    {
        std::ofstream stream(path);
        stream.precision(16);
        constexpr int instants = 200;
        for (int k = 0; k <= instants; ++k) {
            const double phase = full_turn * k / instants;
            const VectorXd y = after(system, x, phase, theta);
            stream << phase / omega << ' ' << y(0) + phase << ' ' << y(1) << ' ' << std::sin(phase) << ' '
                   << std::cos(phase) << '\n';
        }
    }
    std::vector<Generation> result;
    const std::string command = std::string(ORBID_SOURCE_DIR) + "/bench/auto/cascade.sh " + path.string();
    if (FILE* pipe = popen(command.c_str(), "r"); pipe != nullptr) {
        char line[256];
        std::string text;
        while (std::fgets(line, sizeof line, pipe) != nullptr) {
            text = line;
            Generation one;
            int period = 0;
            std::istringstream words(text);
            if (words >> period >> one.points >> one.time >> one.doubling)
                result.push_back(one);
            else
                std::printf("%s", line);
        }
        pclose(pipe);
    }
    std::filesystem::remove(path);
    return result;
}

}  // namespace

int main() {
    const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
    const auto system = models::make_system("parametric_pendulum");
    VectorXd theta = system->default_parameters();
    periodic::ContinuationOptions options;
    options.parameter = system->parameter_index("omega");
    options.lower = 9.0;
    options.upper = 13.0;
    theta(options.parameter) = options.upper;
    VectorXd x = Eigen::Vector2d(0.0, options.upper);
    for (int k = 0; k < 400; ++k) {
        x = after(*system, x, full_turn, theta);
        x(0) = models::wrapped(x(0));
    }
    periodic::StartingSolution start;
    start.points = x;

    const std::vector<Generation> ours = cascade(*system, theta, start, options);
    options.solver.flow.relative_tolerance = options.solver.flow.absolute_tolerance = 1e-14;
    const std::vector<Generation> finer = cascade(*system, theta, start, options);
    const std::vector<Generation> theirs = peer(*system, theta, x, options.upper);

    std::printf("cascade of the parametric pendulum, one thread\n");
    std::printf("%6s %20s %9s %9s %8s %9s %16s %8s %9s %9s %7s\n", "period", "doubling [rad/s]", "error", "to 1e-14",
                "points", "ms/point", "AUTO", "points", "ms/point", "apart", "ratio");
    std::vector<double> doublings;
    for (std::size_t g = 0; g < ours.size(); ++g) {
        const double each = 1e3 * ours[g].time / static_cast<double>(ours[g].points);
        std::printf("%6d %20.14f %9.1e %9.1e %8zu %9.3f", 1 << g, ours[g].doubling, ours[g].error,
                    std::abs(ours[g].doubling - finer[g].doubling), ours[g].points, each);
        if (g < theirs.size()) {
            const double other = 1e3 * theirs[g].time / static_cast<double>(theirs[g].points);
            std::printf(" %16.10f %8zu %9.3f %9.1e %7.1f", theirs[g].doubling, theirs[g].points, other,
                        std::abs(ours[g].doubling - theirs[g].doubling), other / each);
        }
        std::printf("\n");
        doublings.push_back(ours[g].doubling);
    }
    for (std::size_t g = 0; g < std::min(ours.size(), theirs.size()); ++g)
        bench::print_ratio("a point of a branch, period " + std::to_string(1 << g), "AUTO-07p",
                           1e3 * ours[g].time / static_cast<double>(ours[g].points),
                           1e3 * theirs[g].time / static_cast<double>(theirs[g].points), "ms");
    std::printf("ratios of the intervals:");
    for (const double ratio : periodic::doubling_ratios(doublings))
        std::printf(" %.6f", ratio);
    std::printf("\n");
}

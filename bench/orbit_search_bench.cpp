// All periodic orbits of a model without data: counts by period and by origin, starts solved, processor time; beside
// the search in a measured series, find_cycles() on 2^20 simulated points of the same model, in the same run.
//   orbit_search_bench [model, default parametric_pendulum] [longest period, default 5] [log2 of the points, default
//   17]
//                      [box of find_cycles(), default 0.1; 0: without]
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <map>
#include <string>
#include <vector>

#include "models/catalogue/registry.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "periodic/search/index_sum.hpp"
#include "periodic/search/orbit_search.hpp"

namespace {

using namespace orbid;
using Eigen::Index;
using Eigen::VectorXd;

/// Processor time of all threads, and time on the wall.
class Watch {
public:
    [[nodiscard]] double processor() const { return static_cast<double>(std::clock() - clock_) / CLOCKS_PER_SEC; }
    [[nodiscard]] double wall() const {
        return std::chrono::duration<double>(std::chrono::steady_clock::now() - wall_).count();
    }

private:
    std::clock_t clock_ = std::clock();
    std::chrono::steady_clock::time_point wall_ = std::chrono::steady_clock::now();
};

void search(const models::System& system, const VectorXd& theta, periodic::OrbitSearchOptions options,
            const char* title) {
    const Watch watch;
    const auto found = search_orbits(system, theta, options);
    std::printf("%s: %zu starts, %zu trajectories captured, %.1f s of the processor, %.1f s\n", title, found.starts,
                found.captured, watch.processor(), watch.wall());
    std::vector<periodic::PeriodicOrbit> orbits;
    std::map<int, std::map<std::string, int>> counts;
    for (const auto& entry : found.orbits) {
        auto& count = counts[entry.orbit.period];
        ++count[std::string(name(entry.origin))];
        ++count["all"];
        orbits.push_back(entry.orbit);
    }
    const std::vector<int> sums = index_sums(orbits, options.periods.back());
    for (std::size_t i = 0; i < options.periods.size(); ++i) {
        std::printf("  period %2d%s, sum of indices %d:", options.periods[i], found.settled[i] ? ", settled" : "",
                    sums[i]);
        for (const auto& [origin, number] : counts[options.periods[i]])
            std::printf(" %s %d", origin.c_str(), number);
        std::printf("\n");
    }
}

/// Number of cycles of every period in a series of 2^20 points.
void search_series(const models::System& system, const VectorXd& theta, int longest, double box) {
    orbits::VirtualExperimentOptions experiment;
    experiment.plan = orbits::SectionPlan{std::size_t{1} << 20U};
    experiment.trajectories = 256;
    const Watch simulation;
    const auto run = orbits::simulate(system, theta, experiment);
    std::printf("series of 2^20 points: %.1f s of the processor, %.1f s\n", simulation.processor(), simulation.wall());
    orbits::CycleSearchOptions options;
    options.periods.clear();
    for (int p = 1; p <= longest; ++p)
        options.periods.push_back(p);
    options.box = box;
    if (const auto symmetry = system.symmetry(); symmetry && symmetry->phase_shift == 0.0)
        options.symmetry_signs = symmetry->signs;
    const Watch watch;
    const auto found = orbits::find_cycles(run.series, options);
    std::map<int, int> counts;
    for (const auto& cycle : found.cycles)
        ++counts[cycle.period];
    std::printf("find_cycles, box %.2f: %.1f s of the processor, %.1f s;", box, watch.processor(), watch.wall());
    for (const auto& [period, number] : counts)
        std::printf(" %d: %d", period, number);
    std::printf("\n");
}

}  // namespace

int main(int argc, char** argv) {
    const std::string model = argc > 1 ? argv[1] : "parametric_pendulum";
    const int longest = argc > 2 ? std::atoi(argv[2]) : 5;
    const auto system = models::make_system(model);
    VectorXd theta = system->default_parameters();
    periodic::OrbitSearchOptions options;
    if (model == "parametric_pendulum") {
        theta(system->parameter_index("g")) = 9.81;
        theta(system->parameter_index("k1")) = 0.0;
    }
    if (model == "lorenz") options.section = models::Section{Eigen::Vector3d::UnitZ(), 27.0, 1};
    if (model == "rossler") options.section = models::Section{Eigen::Vector3d::UnitX(), 0.0, -1};
    options.periods.clear();
    for (int p = 1; p <= longest; ++p)
        options.periods.push_back(p);
    options.points = std::size_t{1} << static_cast<std::size_t>(argc > 3 ? std::atoi(argv[3]) : 17);
    search(*system, theta, options, "search");
    options.stabilised = false;
    search(*system, theta, options, "search without stabilised iterations");
    const double box = argc > 4 ? std::atof(argv[4]) : 0.1;
    if (box > 0.0 && system->kind() != models::Kind::autonomous) search_series(*system, theta, longest, box);
    return 0;
}

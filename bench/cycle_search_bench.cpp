// Time of the periodic orbit analysis of a simulated pendulum section, per point, and how many cycles it finds.
//   cycle_search_bench [log2 of the number of sections, default 18]
#include <chrono>
#include <cstdio>
#include <cstdlib>

#include "models/registry.hpp"
#include "orbits/cycle_search.hpp"

int main(int argc, char** argv) {
    using namespace orbid;
    const auto seconds = [](auto from) {
        return std::chrono::duration<double>(std::chrono::steady_clock::now() - from).count();
    };
    const int exponent = argc > 1 ? std::atoi(argv[1]) : 18;
    if (exponent < 10 || exponent > 24) {
        std::fprintf(stderr, "log2 of the number of sections must be in [10, 24]\n");
        return 2;
    }
    const auto system = models::make_system("parametric_pendulum");
    constexpr Eigen::Index trajectories = 8;
    constexpr std::size_t transient = 100;
    Eigen::MatrixXd starts(2, trajectories);
    for (Eigen::Index i = 0; i < trajectories; ++i)
        starts.col(i) << 0.3 * static_cast<double>(i) - 1.0, 3.0;
    const std::size_t length = (std::size_t{1} << exponent) / trajectories;

    auto start = std::chrono::steady_clock::now();
    const auto ensemble = system->ensemble(starts, 0.0, transient + length, system->default_parameters());
    const double simulation = seconds(start);

    orbits::Series series;
    series.coordinates = {{"phi", "rad", true}, {"phi_dot", "rad/s", false}};
    for (const Eigen::MatrixXd& section : ensemble.sections)
        series.segments.push_back({"", section.rightCols(static_cast<Eigen::Index>(length)), {}});
    orbits::CycleSearchOptions options;
    options.symmetry_signs = system->symmetry()->signs;
    start = std::chrono::steady_clock::now();
    const auto search = find_cycles(series, options);
    const double analysis = seconds(start);

    std::printf("sections %zu  simulation %.3f s  analysis %.3f s (%.0f ns per point, %.2f of the simulation)\n",
                series.size(), simulation, analysis, 1e9 * analysis / static_cast<double>(series.size()),
                analysis / simulation);
    for (const int period : options.periods) {
        int count = 0;
        for (const auto& cycle : search.cycles)
            count += cycle.period == period ? 1 : 0;
        std::printf("period %d: %d cycles\n", period, count);
    }
    std::printf("starts %zu, rejected %zu\n", search.candidates, search.rejected);
    return 0;
}

// Time per point and memory of the search for cycles as the series grows: Henon's map and the pendulum's section.
//   scale_bench [henon | pendulum] [number of points, default 1e6] [largest period, default 5] [box, default 0.1]
//               [memory in MB: the series is written to a file and streamed from there]
// Memory is the highest of the whole program, the series included, as a multiple of the series' own.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <string>

#include "models/catalogue/registry.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/cycles/streamed_search.hpp"
#include "orbits/records/series_file.hpp"
#include "orbits/records/series_stream.hpp"

namespace {

using namespace orbid;

double seconds(std::chrono::steady_clock::time_point from) {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - from).count();
}

// Memory of this process [byte]: "VmHWM" = highest so far, "VmRSS" = now. 0 where the system does not tell.
double memory(const char* entry) {
    std::ifstream status("/proc/self/status");
    for (std::string line; std::getline(status, line);)
        if (line.rfind(entry, 0) == 0) return 1024.0 * std::strtod(line.c_str() + std::strlen(entry) + 1, nullptr);
    return 0.0;
}

orbits::Series henon(Eigen::Index count) {
    orbits::Series series;
    series.coordinates = {{"x", "", false}, {"y", "", false}};
    series.segments.push_back({"", Eigen::MatrixXd(2, count), {}});
    double x = 0.1, y = 0.1;
    for (Eigen::Index i = -100; i < count; ++i) {
        const double next = 1.0 - 1.4 * x * x + y;
        y = 0.3 * x;
        x = next;
        if (i >= 0) series.segments[0].values.col(i) << x, y;
    }
    return series;
}

// In pieces, so that the simulation needs no more memory than the series itself.
orbits::Series pendulum(Eigen::Index count, const models::System& system) {
    constexpr Eigen::Index trajectories = 4;
    constexpr Eigen::Index piece = 1 << 16;
    constexpr Eigen::Index transient = 100;
    const Eigen::Index length = count / trajectories;
    orbits::Series series;
    series.coordinates = {{"phi", "rad", true}, {"phi_dot", "rad/s", false}};
    Eigen::MatrixXd states(2, trajectories);
    for (Eigen::Index i = 0; i < trajectories; ++i) {
        states.col(i) << 0.3 * static_cast<double>(i) - 1.0, 3.0;
        series.segments.push_back({"", Eigen::MatrixXd(2, length), {}});
    }
    for (Eigen::Index done = -transient; done < length;) {
        const Eigen::Index steps = done < 0 ? transient : std::min(piece, length - done);
        const auto ensemble =
            system.ensemble(states, 0.0, static_cast<std::size_t>(steps) + 1, system.default_parameters());
        for (Eigen::Index i = 0; i < trajectories; ++i) {
            const Eigen::MatrixXd& section = ensemble.sections[static_cast<std::size_t>(i)];
            if (done >= 0)
                series.segments[static_cast<std::size_t>(i)].values.middleCols(done, steps) = section.leftCols(steps);
            states.col(i) = section.col(steps);
        }
        done += steps;
    }
    return series;
}

}  // namespace

int main(int argc, char** argv) {
    const std::string name = argc > 1 ? argv[1] : "henon";
    const double asked = argc > 2 ? std::atof(argv[2]) : 1e6;
    const int longest = argc > 3 ? std::atoi(argv[3]) : 5;
    const double box = argc > 4 ? std::atof(argv[4]) : 0.1;
    const double megabytes = argc > 5 ? std::atof(argv[5]) : 0.0;
    if (!(asked >= 1e4 && asked <= 1e9) || !(longest >= 1 && longest <= 64) || !(box > 0.0 && box < 0.5) ||
        (name != "henon" && name != "pendulum")) {
        std::fprintf(stderr,
                     "scale_bench [henon | pendulum] [number of points, 1e4 to 1e9] [largest period] [box] [MB]\n");
        return 2;
    }
    const auto system = models::make_system("parametric_pendulum");
    const double before = memory("VmRSS:");
    auto start = std::chrono::steady_clock::now();
    const auto count = static_cast<Eigen::Index>(asked);
    orbits::Series series = name == "henon" ? henon(count) : pendulum(count, *system);
    const double simulation = seconds(start);
    const double simulated = memory("VmHWM:") - before;

    orbits::CycleSearchOptions options;
    options.box = box;
    options.minimum_recurrences = 1;
    options.periods.clear();
    for (int period = 1; period <= longest; ++period)
        options.periods.push_back(period);
    if (name == "pendulum") options.symmetry_signs = system->symmetry()->signs;
    const auto points = static_cast<double>(series.size());
    const double data = points * 8.0 * static_cast<double>(series.dimension());
    orbits::CycleSearch search;
    std::clock_t processor = std::clock();
    if (megabytes > 0.0) {
        const auto file = std::filesystem::temp_directory_path() / "scale_bench.h5";
        write_hdf5(file, series);
        series = {};
        std::ofstream("/proc/self/clear_refs") << 5;  // the highest memory from here on
        start = std::chrono::steady_clock::now();
        processor = std::clock();
        search = find_cycles(*orbits::stream_hdf5(file), options, static_cast<std::size_t>(1e6 * megabytes));
        std::filesystem::remove(file);
        for (const std::string& remark : search.remarks)
            std::printf("%s\n", remark.c_str());
    } else {
        start = std::chrono::steady_clock::now();
        search = find_cycles(series, options);
    }
    const double analysis = seconds(start);
    const double of_processor = static_cast<double>(std::clock() - processor) / CLOCKS_PER_SEC;
    std::printf(
        "%s: %.0f points, simulated in %.2f s; search %.2f s (processor %.2f s), %.0f ns per point; memory %.0f MB, "
        "%.2f x the series "
        "(simulated %.2f x); cycles",
        name.c_str(), points, simulation, analysis, of_processor, 1e9 * analysis / points,
        1e-6 * (memory("VmHWM:") - before), (memory("VmHWM:") - before) / data, simulated / data);
    for (const int period : options.periods) {
        int cycles = 0;
        for (const auto& cycle : search.cycles)
            cycles += cycle.period == period ? 1 : 0;
        std::printf(" %d", cycles);
    }
    std::printf(" (periods 1-%d)\n", longest);
    return 0;
}

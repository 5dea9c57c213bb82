// The search for cycles in clean series: how many are found, how many are the model's, how exact they are, and what it
// costs against peers measured in the same run.
//
//     cycle_search_bench [pendulum | shuffled [BOX [LOG2_OF_POINTS [NOISE]]]] [henon [BOX [LOG2_OF_POINTS]]]
//
// Without arguments: the pendulum with boxes of 1, 10 and 40 % of 2^20 points, then the Henon map.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include <tbb/parallel_for.h>
#include <Eigen/LU>

#include "bench/odeint_loop.hpp"
#include "bench/ratio.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/sections/neighbour_index.hpp"
#include "orbits/sections/section_points.hpp"
#include "tests/orbits/cycles/true_cycles.hpp"
#include "tests/orbits/sections/map_series.hpp"

#ifdef ORBID_BENCH_PEERS
#include "bench/nanoflann_tree.hpp"
#endif

namespace {

using namespace orbid;

template <class Work>
double seconds_of(const Work& work) {
    const auto start = std::chrono::steady_clock::now();
    work();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// One pass that builds the grid and finds the 40 nearest neighbours of every 100th point, one thread.
double grid_pass(const orbits::SectionPoints& points) {
    std::size_t found = 0;
    const double seconds = seconds_of([&] {
        const orbits::NeighbourIndex grid(points);
        for (std::size_t i = 0; i < points.size(); i += 100)
            found += grid.nearest(Eigen::Map<const Eigen::VectorXd>(points.point(i), points.dimension()), 40).size();
    });
    if (found == 0) std::printf("no neighbours\n");
    return seconds;
}

// Simulating the series again with Boost.Odeint on all cores, from every 64th of its points, times 64. The tolerance is
// where its error per period is ours (ensemble_bench).
double odeint_simulation(const orbits::Series& series) {
    constexpr std::size_t stride = 64, parts = 64;
    std::vector<std::vector<bench::Point>> points(parts);
    std::size_t at = 0;
    for (const orbits::Segment& segment : series.segments)
        for (Eigen::Index i = 0; i < segment.values.cols(); i += stride)
            points[at++ % parts].push_back({segment.values(0, i), segment.values(1, i)});
    return static_cast<double>(stride) * seconds_of([&] {
               tbb::parallel_for(std::size_t{0}, parts, [&](std::size_t part) {
                   std::size_t abandoned = 0;
                   bench::images_by_odeint(bench::Pendulum::parametric, 0.0, bench::Method::rkf78, 7.5e-14,
                                           points[part], abandoned);
               });
           });
}

void shuffle(orbits::Series& series) {
    std::mt19937_64 random(17);
    orbits::Readings& values = series.segments[0].values;
    for (const orbits::Segment& segment : series.segments)
        if (&segment != &series.segments[0]) {
            Eigen::MatrixXd both(values.rows(), values.cols() + segment.values.cols());
            both << values, segment.values;
            values = both;
        }
    series.segments.resize(1);
    for (Eigen::Index i = values.cols() - 1; i > 0; --i)
        values.col(i).swap(values.col(static_cast<Eigen::Index>(random() % static_cast<std::uint64_t>(i + 1))));
}

void pendulum(double box, int exponent, double noise, bool shuffled) {
    const auto system = models::make_system("parametric_pendulum");
    orbits::Series series;
    const double simulation =
        seconds_of([&] { series = tests::pendulum_record(*system, std::size_t{1} << exponent, noise, 1); });
    if (shuffled) shuffle(series);
    orbits::CycleSearchOptions options;
    options.method = orbits::CycleSearchOptions::Method::local_maps;
    options.symmetry_signs = system->symmetry()->signs;
    options.box = box;
    options.minimum_recurrences = 1;
    orbits::CycleSearch search;
    const double seconds = seconds_of([&] { search = find_cycles(series, options); });
    const double pass = grid_pass(orbits::SectionPoints(series, options.symmetry_signs));
    const double odeint = odeint_simulation(series);
    std::printf(
        "pendulum%s, %zu sections, noise %g, boxes of %g %%: %.2f s = %.1f grid passes of %.2f s = %.2f x Odeint's "
        "simulation of %.1f s (ours: %.2f s)\n",
        shuffled ? " shuffled" : "", series.size(), noise, 100.0 * box, seconds, seconds / pass, pass, seconds / odeint,
        odeint, simulation);
    std::printf("starts %zu, rejected %zu\n", search.candidates, search.rejected);
    const auto truths =
        tests::true_cycles(*system, tests::pendulum_at(*system, 0.0), search.cycles, tests::pendulum_range());
    std::printf(
        "period found true twice | position: median worst | multiplier: median worst | error/sd: rms largest, "
        "ln|multiplier| rms\n");
    for (const int period : {1, 2, 3, 4, 5, 0}) {
        const auto s = tests::summary(search.cycles, truths, period);
        std::printf("%6d %5zu %4zu %5zu | %.1e %.1e | %.1e %.1e | %.2f %.2f, %.2f\n", period, s.found, s.true_ones,
                    s.repeated, s.median_position, s.worst_position, s.median_multiplier, s.worst_multiplier, s.z_rms,
                    s.z_largest, s.ln_multiplier_z_rms);
    }
    if (std::getenv("ORBID_BENCH_MESSAGES") == nullptr) return;
    for (std::size_t i = 0; i < search.cycles.size(); ++i) {
        const auto& cycle = search.cycles[i];
        const auto& truth = truths[i];
        std::printf("%d %s error %.1e sd %.1e z %.2f multiplier %.4g (%.1e, z %.2f) recurrences %zu", cycle.period,
                    truth.is_true ? "true" : "FALSE", truth.position_error,
                    std::sqrt(cycle.covariance.diagonal().maxCoeff()),
                    truth.z.size() > 0 ? truth.z.cwiseAbs().maxCoeff() : 0.0, cycle.multipliers[0].real(),
                    truth.multiplier_error, truth.ln_multiplier_z, cycle.recurrences);
        for (const std::string& remark : cycle.quality)
            std::printf("; %s", remark.c_str());
        std::printf("\n");
    }
}

// The cycle of the table that is nearest, and its largest distance to the found one.
struct Match {
    double error = std::numeric_limits<double>::infinity();
    double multiplier_error = 0.0;
};

void henon(double box, int exponent) {
    const auto series = tests::henon_series(Eigen::Index{1} << exponent);
    std::ifstream file(ORBID_SOURCE_DIR "/tests/reference/henon_cycles.json");
    const nlohmann::json reference = nlohmann::json::parse(file);
    orbits::CycleSearchOptions options;
    options.method = orbits::CycleSearchOptions::Method::local_maps;
    options.periods = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10};
    options.box = box;
    options.minimum_recurrences = 1;
    orbits::CycleSearch search;
    const double seconds = seconds_of([&] { search = find_cycles(series, options); });
    std::printf("Henon map, %zu points, boxes of %g %%, periods 1-10: %.3f s, %zu starts, %zu rejected\n",
                series.size(), 100.0 * box, seconds, search.candidates, search.rejected);
    const std::array<int, 11> expected{0, 1, 1, 0, 1, 0, 2, 4, 7, 6, 10};
    for (int period = 1; period <= 10; ++period) {
        int found = 0;
        double worst = 0.0, worst_multiplier = 0.0, squares = 0.0, count = 0.0;
        for (const orbits::Cycle& cycle : search.cycles) {
            if (cycle.period != period) continue;
            ++found;
            // Newton on the map itself: x_{j+1} = 1 - 1.4 x_j^2 + 0.3 x_{j-1}, from the found points.
            const Eigen::Index p = cycle.period;
            Eigen::VectorXd x = cycle.points.row(0).transpose();
            for (int step = 0; step < 8; ++step) {
                Eigen::MatrixXd slope = Eigen::MatrixXd::Zero(p, p);
                Eigen::VectorXd defect(p);
                for (Eigen::Index j = 0; j < p; ++j) {
                    defect[j] = x[(j + 1) % p] - 1.0 + 1.4 * x[j] * x[j] - 0.3 * x[(j + p - 1) % p];
                    slope(j, (j + 1) % p) += 1.0;
                    slope(j, j) += 2.8 * x[j];
                    slope(j, (j + p - 1) % p) -= 0.3;
                }
                x -= slope.partialPivLu().solve(defect);
            }
            Eigen::Matrix2d product = Eigen::Matrix2d::Identity();
            for (Eigen::Index j = 0; j < p; ++j) {
                product = Eigen::Matrix2d{{-2.8 * x[j], 1.0}, {0.3, 0.0}} * product;
                const double error = std::max(std::abs(cycle.points(0, j) - x[j]),
                                              std::abs(cycle.points(1, j) - 0.3 * x[(j + p - 1) % p]));
                worst = std::max(worst, error);
                squares += std::pow(cycle.points(0, j) - x[j], 2) / cycle.covariance(2 * j, 2 * j);
                count += 1.0;
            }
            const double trace = product.trace(), determinant = std::pow(-0.3, p);
            const double large = 0.5 * trace + std::copysign(std::sqrt(0.25 * trace * trace - determinant), trace);
            worst_multiplier = std::max(worst_multiplier, std::abs(cycle.multipliers[0].real() / large - 1.0));
        }
        std::printf("period %2d: %d of %d, position %.1e at worst, multiplier %.1e, error/sd rms %.2f\n", period, found,
                    expected[static_cast<std::size_t>(period)], worst, worst_multiplier,
                    count > 0.0 ? std::sqrt(squares / count) : 0.0);
    }
#ifdef ORBID_BENCH_PEERS
    const orbits::Readings& values = series.segments[0].values;
    const double peer = seconds_of([&] {
        const NanoflannTree tree(std::vector<double>(values.data(), values.data() + values.size()));
        if (tree.farthest_of(24).empty()) std::printf("no neighbours\n");
    });
    bench::print_ratio("Henon: the whole search for cycles", "nanoflann's 24 nearest of all points alone", seconds,
                       peer, "s");
#endif
}

}  // namespace

int main(int argc, char** argv) {
    const auto number = [&](int at, double otherwise) { return argc > at ? std::atof(argv[at]) : otherwise; };
    if (argc == 1) {
        for (const double box : {0.01, 0.1, 0.4})
            pendulum(box, 20, 0.0, false);
        henon(0.01, 20);
        return 0;
    }
    const std::string what = argv[1];
    const int exponent = static_cast<int>(number(3, 20.0));
    const double box = number(2, what == "henon" ? 0.01 : 0.1);
    if (!(box > 0.0 && box < 0.5) || exponent < 10 || exponent > 26) {
        std::fprintf(stderr, "the box must be in (0, 0.5), log2 of the number of points in [10, 26]\n");
        return 2;
    }
    if (what == "pendulum" || what == "shuffled")
        pendulum(box, exponent, number(4, 0.0), what == "shuffled");
    else if (what == "henon")
        henon(box, exponent);
    else
        std::fprintf(stderr, "usage: cycle_search_bench [pendulum | shuffled | henon [BOX [LOG2 [NOISE]]]]\n");
    return 0;
}

// Time of building the grid and of asking it for the 24 nearest neighbours of every point, against a k-d tree of
// nanoflann on the same points, one thread each. Results are compared: they must be the same points.
//   grid_bench [log2 of the number of points, default 20]
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <utility>
#include <vector>

#include <tbb/global_control.h>

#include "bench/nanoflann_tree.hpp"
#include "bench/ratio.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/sections/neighbour_index.hpp"

namespace {

using namespace orbid;

// Processor time: what else runs on the machine does not count.
double seconds(std::clock_t from) {
    return static_cast<double>(std::clock() - from) / CLOCKS_PER_SEC;
}

orbits::Series henon(std::size_t count) {
    orbits::Series series;
    series.coordinates = {{"x", "", false}, {"y", "", false}};
    Eigen::MatrixXd values(2, static_cast<Eigen::Index>(count));
    double x = 0.1, y = 0.1;
    for (std::size_t i = 0; i < count + 100; ++i) {
        const double next = 1.0 - 1.4 * x * x + y;
        y = 0.3 * x;
        x = next;
        if (i >= 100) values.col(static_cast<Eigen::Index>(i - 100)) << x, y;
    }
    series.segments.push_back({"", std::move(values), {}});
    return series;
}

orbits::Series pendulum(std::size_t count) {
    const auto system = models::make_system("parametric_pendulum");
    constexpr Eigen::Index trajectories = 4;
    constexpr std::size_t transient = 100;
    Eigen::MatrixXd starts(2, trajectories);
    for (Eigen::Index i = 0; i < trajectories; ++i)
        starts.col(i) << 0.3 * static_cast<double>(i) - 1.0, 3.0;
    const std::size_t length = count / trajectories;
    const auto ensemble = system->ensemble(starts, 0.0, transient + length, system->default_parameters());
    orbits::Series series;
    series.coordinates = {{"phi", "rad", true}, {"phi_dot", "rad/s", false}};
    for (const Eigen::MatrixXd& section : ensemble.sections)
        series.segments.push_back({"", section.rightCols(static_cast<Eigen::Index>(length)), {}});
    return series;
}

void compare(const char* name, const orbits::Series& series) {
    constexpr std::size_t k = 24;
    const orbits::SectionPoints points(series);
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    std::clock_t start = std::clock();
    const orbits::NeighbourIndex grid(points);
    const double build = seconds(start);
    std::vector<std::uint32_t> index;
    std::vector<double> coordinates;
    for (std::size_t i = 0; i < points.size(); ++i)
        if (points.has_image(i)) {
            index.push_back(static_cast<std::uint32_t>(i));
            coordinates.insert(coordinates.end(), points.point(i), points.point(i) + 2);
        }
    start = std::clock();
    const NanoflannTree tree(std::move(coordinates));
    const double peer_build = seconds(start);

    std::vector<double> farthest;
    farthest.reserve(index.size());
    Eigen::VectorXd place(2);
    std::vector<orbits::Neighbour> found;
    start = std::clock();
    for (const std::uint32_t i : index) {
        place << points.point(i)[0], points.point(i)[1];
        grid.nearest(place, k, found);
        farthest.push_back(found.back().distance2);
    }
    const double query = seconds(start);
    start = std::clock();
    const std::vector<double> peer = tree.farthest_of(k);
    const double peer_query = seconds(start);
    // The peer knows no circles: 1 % of the points, those at the seam of an angle, are not compared.
    std::size_t different = 0;
    for (std::size_t i = 0; i < index.size(); ++i) {
        const bool near_seam = points.angle()[0] && std::abs(points.point(index[i])[0]) > 0.49;
        if (!near_seam && farthest[i] != peer[i]) ++different;
    }
    const double each = 1e9 / static_cast<double>(index.size());
    std::printf(
        "%-9s %9zu points: build %.3f s, nanoflann %.3f: ratio %.2f;  24 nearest %.0f ns, "
        "nanoflann %.0f: ratio %.2f;  together %.2f;  %zu different\n",
        name, points.size(), build, peer_build, build / peer_build, query * each, peer_query * each, query / peer_query,
        (build + query) / (peer_build + peer_query), different);
    bench::print_ratio(std::string(name) + ": neighbour index and 24 nearest of all points", "nanoflann", build + query,
                       peer_build + peer_query, "s");
}

}  // namespace

int main(int argc, char** argv) {
    const int exponent = argc > 1 ? std::atoi(argv[1]) : 20;
    if (exponent < 10 || exponent > 24) {
        std::fprintf(stderr, "log2 of the number of points must be in [10, 24]\n");
        return 2;
    }
    const std::size_t count = std::size_t{1} << exponent;
    compare("Henon", henon(count));
    compare("pendulum", pendulum(count));
    return 0;
}

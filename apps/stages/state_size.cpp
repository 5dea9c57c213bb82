#include "apps/stages/state_size.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Core>

#include "apps/job/data_job.hpp"
#include "apps/job/periodic_job.hpp"

namespace orbid::apps {

namespace {

/// Values that are not finite count as missing.
void take(const Eigen::Ref<const Eigen::VectorXd>& values, double& largest) {
    for (const double value : values)
        if (std::isfinite(value)) largest = std::max(largest, std::abs(value));
}

}  // namespace

double state_size(const Job& job, std::span<const Experiment> data) {
    const models::System& system = *job.model.system;
    for (const models::Coordinate& coordinate : system.coordinates())
        if (coordinate.angle) return 1.0;
    double largest = 0.0;
    for (const DataJob& experiment : job.data) {
        if (experiment.simulation)
            for (const Eigen::VectorXd& state : experiment.simulation->initial)
                take(state, largest);
    }
    if (job.periodic)
        for (const OrbitStart& orbit : job.periodic->orbits)
            take(orbit.points.reshaped(), largest);
    if (job.section_plane) take(Eigen::VectorXd::Constant(1, job.section_plane->value), largest);
    for (const Experiment& experiment : data) {
        const orbits::Series& series = experiment.series;
        for (std::size_t i = 0; i < series.coordinates.size(); ++i) {
            if (system.coordinate_index(series.coordinates[i].name) < 0) continue;
            for (const orbits::Segment& segment : series.segments)
                take(segment.values.row(static_cast<Eigen::Index>(i)).transpose(), largest);
        }
    }
    // Below the least readings that records may have a tolerance would vanish.
    constexpr double least = 0x1p-400;
    return largest > 0.0 ? std::clamp(std::exp2(std::floor(std::log2(largest))), least, 1.0) : 1.0;
}

}  // namespace orbid::apps

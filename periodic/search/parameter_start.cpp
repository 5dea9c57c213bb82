#include "periodic/search/parameter_start.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include <tbb/parallel_for.h>

#include "periodic/orbit/winding_number.hpp"
#include "periodic/solution/multiple_shooting.hpp"
#include "periodic/solution/newton.hpp"

namespace orbid::periodic {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

void require(bool holds, const std::string& message) {
    if (!holds) throw std::invalid_argument("orbits_at: " + message);
}

void check(const models::System& system, const VectorXd& theta, const VectorXd& theta_new,
           std::span<const PeriodicOrbit> orbits, const CarriedOrbitOptions& options) {
    const auto parameters = system.parameters();
    for (const VectorXd* values : {&theta, &theta_new}) {
        require(values->size() == static_cast<Index>(parameters.size()),
                "theta needs " + std::to_string(parameters.size()) + " values, got " + std::to_string(values->size()));
        for (std::size_t i = 0; i < parameters.size(); ++i)
            require(models::contains(parameters[i].domain, (*values)(static_cast<Index>(i))),
                    std::string(parameters[i].name) + " must be " + std::string(models::rule(parameters[i].domain)) +
                        ", got " + std::to_string((*values)(static_cast<Index>(i))));
    }
    require(options.first_step > 0.0 && options.first_step <= 1.0, "first_step must lie in (0, 1]");
    require(options.smallest_step > 0.0, "smallest_step must be > 0");
    require(options.largest_miss > 0.0, "largest_miss must be > 0");
    require(options.section.has_value() == (system.kind() == models::Kind::autonomous),
            "a section belongs to autonomous models, and is needed there");
    for (const PeriodicOrbit& orbit : orbits)
        require(orbit.status == OrbitStatus::converged && orbit.points.rows() == system.dimension() &&
                    orbit.points.cols() >= 1 && orbit.points.cols() == orbit.period,
                "orbits must be converged, with one point per period or crossing");
}

/// Size of each coordinate over all orbits, so that one at rest is not measured by its rounding errors.
VectorXd common_scale(const models::System& system, std::span<const PeriodicOrbit> orbits) {
    // Units of models are such that nothing of interest is smaller.
    constexpr double rounding = 1e-9;
    MatrixXd largest = MatrixXd::Zero(system.dimension(), 1);
    for (const PeriodicOrbit& orbit : orbits)
        largest = largest.cwiseMax(orbit.points.cwiseAbs().rowwise().maxCoeff());
    return default_scale(system, (largest.array() > rounding).select(largest, 0.0));
}

CarriedOrbit carried(const models::System& system, const VectorXd& theta, const VectorXd& theta_new,
                     const PeriodicOrbit& from, const VectorXd& scale, const CarriedOrbitOptions& options) {
    const std::vector<Index> angles = angle_coordinates(system);
    CarriedOrbit result;
    result.orbit = from;
    ShootingOptions solver = options.solver;
    solver.scale = scale;
    solver.maximum_distance = options.largest_miss;
    MatrixXd slope = MatrixXd::Zero(from.points.rows(), from.points.cols());  // by the share
    double step = options.first_step;
    while (result.share < 1.0) {
        // The last step ends at 1 exactly.
        const double share = result.share + step > 1.0 - 1e-9 ? 1.0 : result.share + step;
        StartingSolution start;
        start.phase = options.phase;
        start.section = options.section;
        start.points = wrapped_angles(result.orbit.points + (share - result.share) * slope, angles);
        // Angles keep their turns; orbits of flows without angles have none to keep.
        start.rotation = from.rotation;
        const VectorXd there = share == 1.0 ? theta_new : VectorXd(theta + share * (theta_new - theta));
        PeriodicOrbit next = solve_multiple_shooting(system, there, start, {}, solver);
        if (next.status != OrbitStatus::converged) {
            result.lost = next.status;
            step *= 0.5;
            if (step < options.smallest_step) return result;
            continue;
        }
        slope = wrapped_angles(next.points - result.orbit.points, angles) / (share - result.share);
        if (next.distance < 0.25 * options.largest_miss) step *= 2.0;
        result.orbit = std::move(next);
        result.share = share;
    }
    result.arrived = true;
    result.lost = OrbitStatus::converged;
    return result;
}

}  // namespace

std::vector<CarriedOrbit> orbits_at(const models::System& system, const VectorXd& theta, const VectorXd& theta_new,
                                    std::span<const PeriodicOrbit> orbits, const CarriedOrbitOptions& options) {
    check(system, theta, theta_new, orbits, options);
    const VectorXd scale = options.solver.scale.size() > 0 ? options.solver.scale : common_scale(system, orbits);
    std::vector<CarriedOrbit> result(orbits.size());
    tbb::parallel_for(std::size_t{0}, orbits.size(),
                      [&](std::size_t k) { result[k] = carried(system, theta, theta_new, orbits[k], scale, options); });
    return result;
}

}  // namespace orbid::periodic

#include "periodic/multiple_shooting.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "periodic/approach.hpp"
#include "periodic/closing_error.hpp"
#include "periodic/discretisation.hpp"
#include "periodic/flow_steps.hpp"
#include "periodic/orbit_solution.hpp"
#include "periodic/whole_turn.hpp"

namespace orbid::periodic {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

PeriodicOrbit solve_multiple_shooting(const models::System& system, const VectorXd& theta,
                                      const StartingSolution& start, std::span<const Index> free,
                                      const ShootingOptions& options) {
    validate(system, free, options);
    Course course = course_through(system, theta, start, options.flow);
    DiscreteStart first;
    if (course.simulated) {
        double share = 0.0;
        for (const Segment& segment : course.segments) {
            first.points.push_back(share);
            share += segment.share;
        }
        const VectorXd scale = options.scale.size() > 0 ? options.scale : default_scale(system, start.points);
        const Approach near = approach(system, theta, course, start, scale, options);
        course = near.course;
        first.rotation = near.rotation;
        first.iterations = near.iterations;
        const auto close = [&] {
            return closing_error(FlowSteps(system, theta, course, options.flow), course.nodes, course.time,
                                 MatrixXd::Zero(course.nodes.rows(), course.nodes.cols()));
        };
        first.closing = close();
        const bool grows = first.closing.simulated &&
                           std::any_of(first.closing.jacobians.begin(), first.closing.jacobians.end(),
                                       [&](const MatrixXd& x) { return grows_beyond(x, options.segment_growth); });
        if (grows && system.kind() != models::Kind::map) {
            course = refined(system, theta, course, options.segment_growth, options.flow);
            first.closing = close();
        }
        if (system.kind() == models::Kind::autonomous && !start.section) first.points.clear();
    }
    first.nodes = course.nodes;
    first.time = course.time;
    return solve_discrete(system, theta, start, FlowSteps(system, theta, course, options.flow), first, free, options)
        .orbit;
}

PeriodicOrbit solve_multiple_shooting(const models::System& system, const VectorXd& theta, double phase,
                                      const MatrixXd& guess, std::span<const int> rotation, std::span<const Index> free,
                                      const ShootingOptions& options) {
    if (system.kind() == models::Kind::autonomous)
        throw std::invalid_argument("solve_multiple_shooting: the model must be forced or a map; " +
                                    std::string(system.name()) + " is autonomous");
    StartingSolution start;
    start.points = guess;
    start.rotation.assign(rotation.begin(), rotation.end());
    start.phase = phase;
    return solve_multiple_shooting(system, theta, start, free, options);
}

}  // namespace orbid::periodic

#include "periodic/multiple_shooting.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "periodic/closing_error.hpp"
#include "periodic/discretisation.hpp"
#include "periodic/orbit_solution.hpp"

namespace orbid::periodic {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// The flow over the segments of a course.
class FlowSteps final : public Discretisation {
public:
    FlowSteps(const models::System& system, const VectorXd& theta, const Course& course,
              const models::FlowOptions& options)
        : system_(system), theta_(theta), clock_(course.clock), segments_(course.segments), options_(options) {
        double share = 0.0;
        for (const Segment& segment : segments_) {
            shares_.push_back(share);
            share += segment.share;
        }
    }

    [[nodiscard]] Index steps() const override { return static_cast<Index>(segments_.size()); }
    [[nodiscard]] Index dimension() const override { return system_.dimension(); }
    [[nodiscard]] bool unknown_time() const override { return system_.kind() == models::Kind::autonomous; }
    [[nodiscard]] double share(Index j) const override { return shares_[static_cast<std::size_t>(j)]; }

    [[nodiscard]] StepImage advance(Index j, const VectorXd& z, double time,
                                    std::span<const Index> free) const override {
        const Segment& segment = segments_[static_cast<std::size_t>(j)];
        const double durations[] = {unknown_time() ? segment.share * time : segment.duration};
        const models::FlowResult flow =
            system_.flow_with_sensitivities(z, segment.phase, durations, theta_, free, clock_, options_);
        StepImage image;
        image.simulated = flow.status == models::FlowStatus::ok;
        if (!image.simulated) return image;
        image.sticking = flow.stickings > 0;
        image.value = flow.states.col(0);
        image.by_state = flow.sensitivities.leftCols(z.size());
        image.by_parameters = flow.sensitivities.rightCols(static_cast<Index>(free.size()));
        if (unknown_time())
            image.by_ln_time = durations[0] * system_.rhs(image.value, std::vector<double>{0.0}, theta_);
        return image;
    }

private:
    const models::System& system_;
    const VectorXd& theta_;
    models::Clock clock_;
    std::vector<Segment> segments_;
    std::vector<double> shares_;
    models::FlowOptions options_;
};

}  // namespace

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

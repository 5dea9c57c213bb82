#include "periodic/flow_steps.hpp"

#include <cstddef>

namespace orbid::periodic {

using Eigen::Index;
using Eigen::VectorXd;

FlowSteps::FlowSteps(const models::System& system, const VectorXd& theta, const Course& course,
                     const models::FlowOptions& options)
    : system_(system), theta_(theta), clock_(course.clock), segments_(course.segments), options_(options) {
    double share = 0.0;
    for (const Segment& segment : segments_) {
        shares_.push_back(share);
        share += segment.share;
    }
}

Index FlowSteps::steps() const {
    return static_cast<Index>(segments_.size());
}

Index FlowSteps::dimension() const {
    return system_.dimension();
}

bool FlowSteps::unknown_time() const {
    return system_.kind() == models::Kind::autonomous;
}

double FlowSteps::share(Index j) const {
    return shares_[static_cast<std::size_t>(j)];
}

StepImage FlowSteps::advance(Index j, const VectorXd& z, double time, std::span<const Index> free) const {
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
    if (unknown_time()) image.by_ln_time = durations[0] * system_.rhs(image.value, std::vector<double>{0.0}, theta_);
    return image;
}

}  // namespace orbid::periodic

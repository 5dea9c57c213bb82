#include "periodic/discretisation/shooting_steps.hpp"

#include <algorithm>
#include <cstddef>

namespace orbid::periodic {

FlowSteps::FlowSteps(const models::System& system, const VectorXd& theta, const ShootingMesh& mesh,
                     const models::FlowOptions& options)
    : Discretisation(mesh.begins(), system.dimension(), system.kind() == models::Kind::autonomous),
      system_(system),
      theta_(theta),
      clock_(mesh.clock),
      segments_(mesh.segments),
      options_(options) {}

StepImage FlowSteps::advance(Index j, const VectorXd& z, double time, std::span<const Index> free) const {
    const Segment& segment = segments_[static_cast<std::size_t>(j)];
    const double durations[] = {duration(segment, time)};
    return image_of(system_.flow_with_sensitivities(z, segment.phase, durations, theta_, free, clock_, options_),
                    durations[0], std::ssize(free));
}

std::vector<StepImage> FlowSteps::advance_all(const MatrixXd& nodes, double time, std::span<const Index> free) const {
    // A block of eight takes as long as six flows alone (torque-driven pendulum, 1e-11 and 1e-9).
    constexpr std::size_t worth_a_block = 6;
    const double durations[] = {duration(segments_.front(), time)};
    const bool alike = std::all_of(segments_.begin(), segments_.end(),
                                   [&](const Segment& one) { return duration(one, time) == durations[0]; });
    if (!alike || segments_.size() < worth_a_block) return Discretisation::advance_all(nodes, time, free);
    std::vector<double> phases;
    for (const Segment& segment : segments_)
        phases.push_back(segment.phase);
    std::vector<StepImage> images;
    for (const models::FlowResult& flow : system_.flows(nodes, phases, durations, theta_, free, clock_, options_))
        images.push_back(image_of(flow, durations[0], std::ssize(free)));
    return images;
}

StepImage FlowSteps::image_of(const models::FlowResult& flow, double duration, Index free) const {
    StepImage image;
    image.simulated = flow.status == models::FlowStatus::ok;
    if (!image.simulated) return image;
    image.sticking = flow.stickings > 0;
    image.value = flow.states.col(0);
    image.by_state = flow.sensitivities.leftCols(dimension());
    image.by_parameters = flow.sensitivities.rightCols(free);
    if (unknown_time()) image.by_ln_time = duration * system_.rhs(image.value, std::vector<double>{0.0}, theta_);
    return image;
}

std::vector<MatrixXd> FlowSteps::propagators(const std::vector<MatrixXd>& jacobians, const MatrixXd& nodes,
                                             double time) const {
    // Two digits; pieces of less gain nothing. Measured on cycles of the torque-driven pendulum up to period 12.
    constexpr double piece_growth = 1e2;
    if (system_.kind() == models::Kind::map) return jacobians;
    std::vector<MatrixXd> factors;
    for (std::size_t j = 0; j < jacobians.size(); ++j) {
        const int pieces = pieces_of(jacobians[j], piece_growth);
        const Segment& segment = segments_[j];
        const double length = duration(segment, time) / pieces;
        std::vector<MatrixXd> parts;
        VectorXd x = nodes.col(static_cast<Index>(j));
        for (int k = 0; pieces > 1 && k < pieces; ++k) {
            const double durations[] = {length};
            const double phase = segment.phase + (clock_ == models::Clock::phase ? k * length : 0.0);
            const models::FlowResult flow =
                system_.flow_with_sensitivities(x, phase, durations, theta_, {}, clock_, options_);
            if (flow.status != models::FlowStatus::ok) break;
            x = flow.states.col(0);
            parts.push_back(flow.sensitivities.leftCols(x.size()));
        }
        if (static_cast<int>(parts.size()) != pieces) parts = {jacobians[j]};
        factors.insert(factors.end(), parts.begin(), parts.end());
    }
    return factors;
}

bool grows_too_much(const models::System& system, const std::vector<MatrixXd>& jacobians,
                    const ShootingOptions& options) {
    return system.kind() != models::Kind::map &&
           std::any_of(jacobians.begin(), jacobians.end(),
                       [&](const MatrixXd& x) { return grows_beyond(x, options.segment_growth); });
}

ClosingError refine_and_close(const models::System& system, const VectorXd& theta, ShootingMesh& mesh,
                              const ShootingOptions& options) {
    const auto close = [&] {
        return closing_error(FlowSteps(system, theta, mesh, options.flow), mesh.nodes, mesh.time);
    };
    ClosingError closing = close();
    if (!closing.simulated || !grows_too_much(system, closing.jacobians, options)) return closing;
    mesh = refined(system, theta, mesh, options.segment_growth, options.flow);
    return close();
}

}  // namespace orbid::periodic

#include "periodic/discretisation/shooting_steps.hpp"

#include <algorithm>
#include <cstddef>

#include <tbb/parallel_for.h>

#include "models/system/left_loop.hpp"

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
    return in_pieces(j, z, time, free, 1);
}

std::vector<int> FlowSteps::pieces(const std::vector<MatrixXd>& jacobians) const {
    // Two digits; pieces of less gain nothing. Measured on cycles of the torque-driven pendulum up to period 12.
    constexpr double piece_growth = 1e2;
    if (system_.kind() == models::Kind::map) return {};
    std::vector<int> pieces;
    for (const MatrixXd& jacobian : jacobians)
        pieces.push_back(pieces_of(jacobian, piece_growth));
    return pieces;
}

std::vector<StepImage> FlowSteps::advance_all(const MatrixXd& nodes, double time, std::span<const Index> free,
                                              std::span<const int> pieces) const {
    // A block of eight takes as long as six flows alone (torque-driven pendulum, 1e-11 and 1e-9).
    constexpr std::size_t worth_a_block = 6;
    const double first = duration(segments_.front(), time);
    const bool alike = std::all_of(segments_.begin(), segments_.end(),
                                   [&](const Segment& one) { return duration(one, time) == first; });
    if (alike && segments_.size() >= worth_a_block)
        return in_blocks(nodes, first, free, pieces.empty() ? 1 : *std::max_element(pieces.begin(), pieces.end()));
    std::vector<StepImage> images(segments_.size());
    tbb::parallel_for(std::size_t{0}, images.size(), [&](std::size_t j) {
        const auto column = static_cast<Index>(j);
        images[j] = in_pieces(column, nodes.col(column), time, free, pieces.empty() ? 1 : pieces[j]);
    });
    models::stop_if_left();
    return images;
}

namespace {

/// Piece number k of so many follows on from those before it.
void join(const models::FlowResult& flow, Index free, int k, int pieces, StepImage& image) {
    const bool first = k == 0;
    image.simulated = (first || image.simulated) && flow.status == models::FlowStatus::ok;
    if (!image.simulated) return;
    const Index n = flow.states.rows();
    const auto by_state = flow.sensitivities.leftCols(n);
    const auto by_parameters = flow.sensitivities.rightCols(free);
    image.sticking = image.sticking || flow.stickings > 0;
    image.value = flow.states.col(0);
    image.by_parameters = first ? MatrixXd(by_parameters) : MatrixXd(by_state * image.by_parameters + by_parameters);
    image.by_state = first ? MatrixXd(by_state) : MatrixXd(by_state * image.by_state);
    if (pieces > 1) image.pieces.emplace_back(by_state);
}

}  // namespace

StepImage FlowSteps::in_pieces(Index j, const VectorXd& z, double time, std::span<const Index> free, int pieces) const {
    const Segment& segment = segments_[static_cast<std::size_t>(j)];
    const double whole = duration(segment, time);
    const double durations[] = {whole / pieces};
    StepImage image;
    for (int k = 0; k < pieces && (k == 0 || image.simulated); ++k) {
        const double phase = segment.phase + (clock_ == models::Clock::phase ? k * durations[0] : 0.0);
        const VectorXd from = k == 0 ? z : image.value;
        join(system_.flow_with_sensitivities(from, phase, durations, theta_, free, clock_, options_), std::ssize(free),
             k, pieces, image);
    }
    add_slope(image, whole);
    return image;
}

std::vector<StepImage> FlowSteps::in_blocks(const MatrixXd& nodes, double duration, std::span<const Index> free,
                                            int pieces) const {
    const double durations[] = {duration / pieces};
    std::vector<StepImage> images(segments_.size());
    MatrixXd from = nodes;
    for (int k = 0; k < pieces; ++k) {
        std::vector<double> phases;
        for (const Segment& segment : segments_)
            phases.push_back(segment.phase + (clock_ == models::Clock::phase ? k * durations[0] : 0.0));
        const auto flows = system_.flows(from, phases, durations, theta_, free, clock_, options_);
        for (std::size_t j = 0; j < images.size(); ++j) {
            join(flows[j], std::ssize(free), k, pieces, images[j]);
            if (images[j].simulated) from.col(static_cast<Index>(j)) = images[j].value;
        }
    }
    for (StepImage& image : images)
        add_slope(image, duration);
    return images;
}

void FlowSteps::add_slope(StepImage& image, double duration) const {
    if (image.simulated && unknown_time())
        image.by_ln_time = duration * system_.rhs(image.value, std::vector<double>{0.0}, theta_);
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

#include "orbits/lifted_cycle_residual.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>

#include <tbb/parallel_for.h>

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Sd of a point relative to the range of its coordinate for weights "equal", where nothing is known: that of a good
/// measurement. Only its ratio to the matching sd counts, which falls to nothing anyway.
constexpr double usual_error = 1e-3;

}  // namespace

LiftedCycleResidual::LiftedCycleResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                                         const std::vector<Cycle>& cycles, double phase, const VectorXd& start,
                                         const VectorXd& matching_sd, const LiftedCycleOptions& options)
    : system_(std::move(system)),
      binding_(std::move(binding)),
      map_(*system_, phase, options.flow),
      targets_(select_targets(map_, binding_.values(start), binding_.parameter, cycles, options.targets)),
      cycle_count_(cycles.size()),
      groups_(target_groups(*system_, "cycles", options.targets)) {
    const Index n = system_->dimension();
    const VectorXd range = target_scale(*system_, cycles);
    for (Index i = 0; i < n; ++i) {
        estimator::ErrorScale& scale = groups_[static_cast<std::size_t>(i)].scale;
        if (!scale.estimate) continue;
        const bool factor = options.targets.weights == CycleWeights::covariance;
        scale = {false, factor ? 1.0 : usual_error * range(i), estimator::FlatPrior{}};
    }
    for (const models::Coordinate& coordinate : system_->coordinates()) {
        estimator::Group group;
        group.name = "matching." + std::string(coordinate.name);
        group.unit = coordinate.unit;
        group.scale.estimate = false;
        groups_.push_back(std::move(group));
    }
    match_with(matching_sd);
    for (const CycleTarget& target : targets_.targets) {
        const Index p = target.points.cols();
        estimator::BlockLayout block;
        block.label = target.label;
        block.group = record_groups(n, p, 0);
        const std::vector<int> matching = record_groups(n, p, static_cast<int>(n));
        block.group.insert(block.group.end(), matching.begin(), matching.end());
        if (target.covariance.size() > 0) {
            block.shape.setIdentity(2 * n * p, 2 * n * p);
            block.shape.topLeftCorner(n * p, n * p) = target.covariance;
        }
        block.latents = n * p;
        layout_.push_back(std::move(block));
        start_.emplace_back(target.points.reshaped());
    }
}

void LiftedCycleResidual::match_with(const VectorXd& matching_sd) {
    const Index n = system_->dimension();
    if (matching_sd.size() != n || !matching_sd.allFinite() || !(matching_sd.minCoeff() > 0.0))
        throw std::invalid_argument("LiftedCycleResidual: matching_sd must hold one finite value > 0 per coordinate");
    for (Index i = 0; i < n; ++i)
        groups_[static_cast<std::size_t>(n + i)].scale.value = matching_sd(i);
}

LiftedCycleResidual LiftedCycleResidual::tightened(const VectorXd& matching_sd, std::vector<VectorXd> latents) const {
    LiftedCycleResidual copy = *this;
    copy.match_with(matching_sd);
    if (latents.empty()) return copy;
    if (latents.size() != layout_.size())
        throw std::invalid_argument("LiftedCycleResidual: " + std::to_string(latents.size()) + " latent vectors for " +
                                    std::to_string(layout_.size()) + " cycles");
    for (std::size_t b = 0; b < latents.size(); ++b)
        if (latents[b].size() != layout_[b].latents || !latents[b].allFinite())
            throw std::invalid_argument("LiftedCycleResidual: latent states of " + layout_[b].label + " must be " +
                                        std::to_string(layout_[b].latents) + " finite numbers");
    copy.start_ = std::move(latents);
    return copy;
}

std::vector<estimator::BlockValue> LiftedCycleResidual::evaluate(const VectorXd& theta,
                                                                 const std::vector<VectorXd>& latents,
                                                                 bool derivatives) const {
    const VectorXd values = binding_.values(theta);
    std::vector<estimator::BlockValue> result(layout_.size());
    const bool allowed = in_domain(*system_, values);
    tbb::parallel_for(std::size_t{0}, layout_.size(), [&](std::size_t b) {
        if (!layout_[b].active) return;
        if (!allowed) {
            result[b].status = estimator::BlockStatus::failed;
            return;
        }
        const MatrixXd& points = targets_.targets[b].points;
        const Index n = points.rows();
        const Index p = points.cols();
        const Index records = n * p;
        const MatrixXd nodes = latents[b].reshaped(n, p);
        estimator::BlockValue& block = result[b];
        block.e.resize(2 * records);
        block.e.head(records) = wrapped_difference(*system_, points, nodes).reshaped();
        if (derivatives) {
            block.e_theta.setZero(2 * records, binding_.estimated_count);
            block.e_z.setZero(2 * records, records);
            block.e_z.topRows(records) = -MatrixXd::Identity(records, records);
        }
        for (Index j = 0; j < p; ++j) {
            const auto image = map_(nodes.col(j), values, binding_.parameter, derivatives);
            if (!image) {
                block.status = estimator::BlockStatus::failed;
                return;
            }
            const Index next = (j + 1) % p;
            const Index row = records + n * j;
            block.e.segment(row, n) = wrapped_difference(*system_, nodes.col(next), image->state);
            if (!derivatives) continue;
            block.e_theta.middleRows(row, n) = -binding_.spread(image->by_free);
            block.e_z.block(row, n * next, n, n) += MatrixXd::Identity(n, n);
            block.e_z.block(row, n * j, n, n) -= image->by_x;
        }
    });
    return result;
}

VectorXd LiftedCycleResidual::matching_defect(const VectorXd& theta, const std::vector<VectorXd>& latents) const {
    const Index n = system_->dimension();
    VectorXd square = VectorXd::Zero(n);
    double count = 0.0;
    for (const estimator::BlockValue& block : evaluate(theta, latents, false)) {
        if (block.status != estimator::BlockStatus::ok || block.e.size() == 0) continue;
        const MatrixXd defects = block.e.tail(block.e.size() / 2).reshaped(n, block.e.size() / (2 * n));
        square += defects.rowwise().squaredNorm();
        count += static_cast<double>(defects.cols());
    }
    return (square / std::max(count, 1.0)).cwiseSqrt();
}

std::vector<MatrixXd> LiftedCycleResidual::nodes(const std::vector<VectorXd>& latents) const {
    std::vector<MatrixXd> result(cycle_count_);
    for (std::size_t b = 0; b < layout_.size() && b < latents.size(); ++b) {
        const MatrixXd& points = targets_.targets[b].points;
        if (layout_[b].active && latents[b].size() == points.size())
            result[targets_.targets[b].cycle] = latents[b].reshaped(points.rows(), points.cols());
    }
    return result;
}

}  // namespace orbid::orbits

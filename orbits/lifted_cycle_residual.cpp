#include "orbits/lifted_cycle_residual.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>

#include <Eigen/Cholesky>

#include "orbits/cycle_block.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Sd of a point relative to the range of its coordinate for weights "equal", where nothing is known: that of a good
/// measurement. Only its ratio to the matching sd counts, which falls to nothing anyway.
constexpr double usual_error = 1e-3;

/// The points alone, whatever the estimate is from: they say which orbits are meant.
CycleTargetOptions points_of(CycleTargetOptions options) {
    options.positions = true;
    options.multipliers = false;
    return options;
}

}  // namespace

LiftedCycleResidual::LiftedCycleResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                                         const std::vector<Cycle>& cycles, double phase, const VectorXd& start,
                                         const VectorXd& matching_sd, const LiftedCycleOptions& options)
    : system_(std::move(system)),
      binding_(std::move(binding)),
      map_(*system_, phase, options.flow),
      reading_(*system_, options.targets.sensor, phase, options.flow),
      exact_(options.exact),
      targets_(select_targets(map_, binding_.values(start), binding_.parameter, cycles, points_of(options.targets))),
      cycle_count_(cycles.size()) {
    const Index n = system_->dimension();
    const VectorXd range = target_scale(*system_, cycles);
    const bool factor = options.targets.weights == CycleWeights::covariance;
    VectorXd size(n);
    for (Index i = 0; i < n; ++i) {
        size(i) = factor ? 1.0 : usual_error * range(i);
        if (options.targets.errors.empty()) continue;
        const estimator::ErrorScale& told = options.targets.errors[static_cast<std::size_t>(i)];
        if (!told.estimate) size(i) = told.value;
    }
    estimator::Group points;
    points.name = "cycles.points";
    points.unit = "1";
    points.scale.estimate = false;
    groups_.push_back(std::move(points));
    for (std::size_t i = 0; i < system_->coordinates().size() && !exact_; ++i) {
        const models::Coordinate& coordinate = system_->coordinates()[i];
        estimator::Group group;
        group.name = "matching." + std::string(coordinate.name);
        group.unit = coordinate.unit;
        group.scale.estimate = false;
        group.distribution = options.matching;
        groups_.push_back(std::move(group));
    }
    for (const CycleTarget& target : targets_.targets) {
        const Index p = target.points.cols();
        estimator::BlockLayout block;
        block.label = target.label;
        block.group.assign(static_cast<std::size_t>(n * p), 0);
        if (exact_) {
            block.constraints = n * p;
        } else {
            const std::vector<int> matching = record_groups(n, p, 1);
            block.group.insert(block.group.end(), matching.begin(), matching.end());
        }
        const VectorXd sizes = size.replicate(p, 1);
        roots_.emplace_back(sizes.asDiagonal());
        if (target.covariance.size() > 0)
            roots_.back() = sizes.asDiagonal() * MatrixXd(Eigen::LLT<MatrixXd>(target.covariance).matrixL());
        block.latents = n * p;
        layout_.push_back(std::move(block));
        start_.emplace_back(target.nodes.reshaped());
    }
    match_with(matching_sd);
}

void LiftedCycleResidual::match_with(const VectorXd& matching_sd) {
    const Index n = system_->dimension();
    if (matching_sd.size() != n || !matching_sd.allFinite() || !(matching_sd.minCoeff() > 0.0))
        throw std::invalid_argument("LiftedCycleResidual: matching_sd must hold one finite value > 0 per coordinate");
    for (estimator::BlockLayout& block : layout_)
        if (exact_) block.constraint_size = matching_sd.replicate(block.constraints / n, 1);
    for (Index i = 0; i < n && !exact_; ++i)
        groups_[static_cast<std::size_t>(1 + i)].scale.value = matching_sd(i);
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

bool LiftedCycleResidual::evaluate_points(std::size_t block, const MatrixXd& nodes, const VectorXd& values,
                                          bool derivatives, estimator::BlockValue& value) const {
    const auto read = reading_(nodes, values, binding_.parameter, derivatives);
    if (!read) return false;
    const Index n = nodes.rows();
    const Index records = nodes.size();
    const auto root = roots_[block].triangularView<Eigen::Lower>();
    value.e.head(records) =
        root.solve(VectorXd(wrapped_difference(*system_, targets_.targets[block].points, read->values).reshaped()));
    if (!derivatives) return true;
    MatrixXd by_nodes = MatrixXd::Zero(records, records);
    MatrixXd by_theta(records, binding_.estimated_count);
    for (Index j = 0; j < nodes.cols(); ++j) {
        by_nodes.block(n * j, n * j, n, n) = -read->by_x[static_cast<std::size_t>(j)];
        by_theta.middleRows(n * j, n) = -binding_.spread(read->by_free[static_cast<std::size_t>(j)]);
    }
    value.e_z.topRows(records) = root.solve(by_nodes);
    value.e_theta.topRows(records) = root.solve(by_theta);
    return true;
}

std::vector<estimator::BlockValue> LiftedCycleResidual::evaluate(const VectorXd& theta,
                                                                 const std::vector<VectorXd>& latents,
                                                                 bool derivatives) const {
    const VectorXd values = binding_.values(theta);
    return evaluate_blocks(*system_, values, layout_, [&](std::size_t b, estimator::BlockValue& block) {
        const Index n = system_->dimension();
        const Index p = targets_.targets[b].points.cols();
        const Index records = n * p;
        const MatrixXd nodes = latents[b].reshaped(n, p);
        const Index rows = exact_ ? records : 2 * records;
        block.e.resize(rows);
        VectorXd defect(records);
        MatrixXd by_theta, by_nodes;
        if (derivatives) {
            block.e_theta.resize(rows, binding_.estimated_count);
            block.e_z.resize(rows, records);
            by_theta.resize(records, binding_.estimated_count);
            by_nodes.setZero(records, records);
        }
        if (!evaluate_points(b, nodes, values, derivatives, block)) return false;
        for (Index j = 0; j < p; ++j) {
            const auto image = map_(nodes.col(j), values, binding_.parameter, derivatives);
            if (!image) return false;
            const Index next = (j + 1) % p;
            defect.segment(n * j, n) = wrapped_difference(*system_, nodes.col(next), image->state);
            if (!derivatives) continue;
            by_theta.middleRows(n * j, n) = -binding_.spread(image->by_free);
            by_nodes.block(n * j, n * next, n, n) += MatrixXd::Identity(n, n);
            by_nodes.block(n * j, n * j, n, n) -= image->by_x;
        }
        if (exact_) {
            block.c = std::move(defect);
            block.c_theta = std::move(by_theta);
            block.c_z = std::move(by_nodes);
            return true;
        }
        block.e.tail(records) = defect;
        if (!derivatives) return true;
        block.e_theta.bottomRows(records) = by_theta;
        block.e_z.bottomRows(records) = by_nodes;
        return true;
    });
}

VectorXd LiftedCycleResidual::matching_defect(const VectorXd& theta, const std::vector<VectorXd>& latents) const {
    const Index n = system_->dimension();
    VectorXd square = VectorXd::Zero(n);
    double count = 0.0;
    for (const estimator::BlockValue& block : evaluate(theta, latents, false)) {
        if (block.status != estimator::BlockStatus::ok || block.e.size() == 0) continue;
        const VectorXd all = exact_ ? block.c : VectorXd(block.e.tail(block.e.size() / 2));
        const MatrixXd defects = all.reshaped(n, all.size() / n);
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

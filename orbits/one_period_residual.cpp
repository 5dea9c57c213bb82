#include "orbits/one_period_residual.hpp"

#include <cmath>
#include <stdexcept>

#include <tbb/parallel_for.h>

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

}  // namespace

OnePeriodResidual::OnePeriodResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                                     const std::vector<Cycle>& cycles, double phase, const VectorXd& start,
                                     const OnePeriodOptions& options)
    : system_(std::move(system)), binding_(std::move(binding)), map_(*system_, phase, options.flow) {
    if (!(options.floor > 0.0)) throw std::invalid_argument("OnePeriodResidual: floor must be > 0");
    CycleTargetOptions target_options = options.targets;
    target_options.weights = CycleWeights::equal;  // sds in the coordinate's unit; no covariance is needed
    target_options.errors.clear();
    target_options.forms.clear();
    target_options.covariances.clear();
    const VectorXd theta = binding_.values(start);
    targets_ = select_targets(map_, theta, binding_.parameter, cycles, target_options);
    groups_ = target_groups(*system_, "one_period", target_options);

    const Index n = system_->dimension();
    range_ = target_scale(*system_, cycles);
    const VectorXd& scale = range_;
    for (const CycleTarget& target : targets_.targets) {
        const Index p = target.points.cols();
        estimator::BlockLayout block;
        block.label = target.label;
        block.group = record_groups(n, p, 0);
        block.shape = options.floor * options.floor * MatrixXd::Identity(n * p, n * p);
        for (Index j = 0; j < p; ++j) {
            const auto image = map_(target.points.col(j), theta, binding_.parameter, true);
            if (!image) continue;  // the floor alone; evaluate() will say that it cannot be predicted
            const MatrixXd gain = scale.cwiseInverse().asDiagonal() * image->by_x * scale.asDiagonal();
            const Index next = (j + 1) % p;
            block.shape.block(n * next, n * next, n, n) += gain * gain.transpose();
        }
        layout_.push_back(std::move(block));
    }
}

std::vector<VectorXd> OnePeriodResidual::initial_latents() const {
    return std::vector<VectorXd>(layout_.size());
}

std::vector<estimator::BlockValue> OnePeriodResidual::evaluate(const VectorXd& theta, const std::vector<VectorXd>&,
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
        estimator::BlockValue& block = result[b];
        block.e.resize(n * p);
        if (derivatives) block.e_theta.resize(n * p, binding_.estimated_count);
        block.e_z.resize(n * p, 0);
        for (Index j = 0; j < p; ++j) {
            const auto image = map_(points.col(j), values, binding_.parameter, derivatives);
            if (!image) {
                block.status = estimator::BlockStatus::failed;
                return;
            }
            const Index row = n * ((j + 1) % p);
            block.e.segment(row, n) = wrapped_difference(*system_, points.col((j + 1) % p), image->state);
            if (derivatives) block.e_theta.middleRows(row, n) = -binding_.spread(image->by_free);
        }
    });
    return result;
}

double OnePeriodResidual::misfit(const VectorXd& theta) const {
    constexpr double off = 0.02;  // of the range: what a model with parameters some per cent wrong leaves
    constexpr double lost = 0.5;
    const std::vector<estimator::BlockValue> blocks = evaluate(theta, initial_latents(), false);
    double sum = 0.0;
    for (std::size_t b = 0; b < blocks.size(); ++b) {
        if (!layout_[b].active) continue;
        const std::vector<int>& group = layout_[b].group;
        for (std::size_t k = 0; k < group.size(); ++k) {
            const double e = blocks[b].status == estimator::BlockStatus::ok
                                 ? blocks[b].e(static_cast<Index>(k)) / range_(group[k])
                                 : lost;
            sum += std::log1p(e * e / (off * off));
        }
    }
    return sum;
}

}  // namespace orbid::orbits

#include "orbits/one_period_residual.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "orbits/cycle_block.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Amplifications that move by less than this change no weight that matters.
constexpr double same_weight = 0.1;
/// Rounds of weights: the first two bring what they can.
constexpr int most_refreshes = 3;

}  // namespace

OnePeriodResidual::OnePeriodResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                                     const std::vector<Cycle>& cycles, double phase, const VectorXd& start,
                                     const OnePeriodOptions& options)
    : system_(std::move(system)),
      binding_(std::move(binding)),
      map_(*system_, phase, options.flow),
      reading_(*system_, options.targets.sensor, phase, options.flow),
      floor_(options.floor) {
    if (!(options.floor > 0.0)) throw std::invalid_argument("OnePeriodResidual: floor must be > 0");
    CycleTargetOptions target_options = options.targets;
    target_options.weights = CycleWeights::equal;  // scales in the coordinate's unit; no covariance is needed
    target_options.positions = true;
    target_options.multipliers = false;
    target_options.errors.clear();
    target_options.forms.clear();
    target_options.covariances.clear();
    const VectorXd theta = binding_.values(start);
    targets_ = select_targets(map_, theta, binding_.parameter, cycles, target_options);
    groups_ = target_groups(*system_, "one_period", target_options);
    for (estimator::Group& group : groups_)
        group.distribution = options.errors;
    range_ = target_scale(*system_, cycles);
    for (const CycleTarget& target : targets_.targets) {
        estimator::BlockLayout block;
        block.label = target.label;
        block.group = record_groups(target.points.rows(), target.points.cols(), 0);
        block.deviation.setConstant(target.points.size(), floor_);
        layout_.push_back(std::move(block));
    }
    weigh(theta);
}

double OnePeriodResidual::weigh(const VectorXd& values) {
    double change = 1.0;
    for (std::size_t b = 0; b < layout_.size(); ++b) {
        const MatrixXd& nodes = targets_.targets[b].nodes;
        const Index n = nodes.rows();
        for (Index j = 0; j < nodes.cols(); ++j) {
            const auto image = map_(nodes.col(j), values, {}, true);
            if (!image) continue;  // the floor alone; evaluate() will say that it cannot be predicted
            const MatrixXd gain = range_.cwiseInverse().asDiagonal() * image->by_x * range_.asDiagonal();
            const VectorXd deviation = (floor_ * floor_ + gain.rowwise().squaredNorm().array()).sqrt();
            auto kept = layout_[b].deviation.segment(n * ((j + 1) % nodes.cols()), n);
            const VectorXd ratio = deviation.cwiseQuotient(kept);
            change = std::max({change, ratio.maxCoeff(), ratio.cwiseInverse().maxCoeff()});
            kept = deviation;
        }
    }
    return change;
}

estimator::RefreshReport OnePeriodResidual::refresh(const VectorXd& theta, const std::vector<VectorXd>&,
                                                    const VectorXd&) {
    estimator::RefreshReport report;
    const VectorXd values = binding_.values(theta);
    if (refreshed_ >= most_refreshes || !in_domain(*system_, values)) return report;
    ++refreshed_;
    for (CycleTarget& target : targets_.targets)
        target.nodes = reading_.states(target.points, values);
    report.changed = weigh(values) > 1.0 + same_weight;
    return report;
}

std::vector<VectorXd> OnePeriodResidual::initial_latents() const {
    return std::vector<VectorXd>(layout_.size());
}

std::vector<estimator::BlockValue> OnePeriodResidual::evaluate(const VectorXd& theta, const std::vector<VectorXd>&,
                                                               bool derivatives) const {
    const VectorXd values = binding_.values(theta);
    return evaluate_blocks(*system_, values, layout_, [&](std::size_t b, estimator::BlockValue& block) {
        const MatrixXd& nodes = targets_.targets[b].nodes;
        const Index n = nodes.rows();
        const Index p = nodes.cols();
        block.e.resize(n * p);
        if (derivatives) block.e_theta.resize(n * p, binding_.estimated_count);
        block.e_z.resize(n * p, 0);
        for (Index j = 0; j < p; ++j) {
            const auto image = map_(nodes.col(j), values, binding_.parameter, derivatives);
            if (!image) return false;
            const Index next = (j + 1) % p;
            block.e.segment(n * next, n) = wrapped_difference(*system_, nodes.col(next), image->state);
            if (derivatives) block.e_theta.middleRows(n * next, n) = -binding_.spread(image->by_free);
        }
        return true;
    });
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

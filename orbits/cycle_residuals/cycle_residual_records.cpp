// Which records a cycle has, their values and derivatives.
#include <algorithm>
#include <cmath>

#include "models/arithmetic/cholesky_factor.hpp"
#include "orbits/cycle_residuals/common_error_filter.hpp"
#include "orbits/cycle_residuals/cycle_residual.hpp"
#include "periodic/stability/stability.hpp"

namespace orbid::orbits {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using periodic::PeriodicOrbit;

bool CycleResidual::lay_out(estimator::ActiveSet& active, std::size_t block, const PeriodicOrbit& orbit) const {
    const CycleTarget& target = targets_.targets[block];
    const auto vanishes = [&](std::size_t m) { return m < orbit.multipliers.size() && orbit.multipliers[m] == 0.0; };
    Known known = this->known(active, block);
    known.multipliers =
        std::none_of(target.multipliers.begin(), target.multipliers.end(), vanishes) && !target.multipliers.empty();
    remember(active, block, known);
    const Index n = target.points.rows();
    const Index multipliers = known.multipliers ? target.ln_multiplier.size() : 0;
    const Index times = std::isfinite(target.time) ? 1 : 0;
    estimator::BlockLayout& layout = active.layout.edit()[block];
    layout.group.clear();
    if (target.positions) layout.group = record_groups(n, target.points.cols(), 0);
    const int of_multipliers = options_.targets.positions ? static_cast<int>(n) : 0;
    layout.group.insert(layout.group.end(), static_cast<std::size_t>(multipliers), of_multipliers);
    if (times > 0) layout.group.push_back(of_multipliers + (options_.targets.multipliers ? 1 : 0));
    return !layout.group.empty();
}

MatrixXd CycleResidual::own_shape(const estimator::ActiveSet& active, std::size_t block) const {
    const CycleTarget& target = targets_.targets[block];
    const auto records = static_cast<Index>(active.layout[block].group.size());
    if (options_.targets.weights != CycleWeights::covariance) return {};
    MatrixXd shape = MatrixXd::Zero(records, records);
    const Index positions = target.positions ? target.points.size() : 0;
    const Index multipliers = has_multipliers(active, block) ? target.ln_multiplier.size() : 0;
    if (positions > 0) shape.topLeftCorner(positions, positions) = target.covariance;
    if (multipliers > 0) shape.block(positions, positions, multipliers, multipliers) = target.multiplier_covariance;
    if (std::isfinite(target.time)) {
        shape(records - 1, records - 1) = target.time_sd * target.time_sd;
        if (positions > 0 && target.time_covariance.size() > 0) {
            shape.col(records - 1).head(positions) = target.time_covariance;
            shape.row(records - 1).head(positions) = target.time_covariance.transpose();
        }
    }
    return shape;
}

MatrixXd CycleResidual::own_common(const estimator::ActiveSet& active, std::size_t block) const {
    const CycleTarget& target = targets_.targets[block];
    if (target.common.size() == 0) return {};
    MatrixXd common = MatrixXd::Zero(std::ssize(active.layout[block].group), shared_);
    const Index positions = target.positions ? target.points.size() : 0;
    const Index multipliers = has_multipliers(active, block) ? target.ln_multiplier.size() : 0;
    common.topRows(positions) = target.common.topRows(positions);
    common.middleRows(positions, multipliers) = target.common.middleRows(target.points.size(), multipliers);
    if (std::isfinite(target.time)) common.bottomRows(1) = target.common.bottomRows(1);
    return common;
}

double CycleResidual::mean_square(const estimator::ActiveSet& active, std::size_t block, const VectorXd& e,
                                  const VectorXd& scales) const {
    VectorXd whitened = e;
    for (Index i = 0; i < e.size(); ++i)
        whitened(i) /= scales(active.layout[block].group[static_cast<std::size_t>(i)]);
    const MatrixXd shape = own_shape(active, block);
    if (shape.size() > 0) models::CholeskyFactor(shape).solve_lower_in_place(whitened);
    return whitened.squaredNorm() / static_cast<double>(e.size());
}

void CycleResidual::link(estimator::ActiveSet& active) const {
    CommonErrorFilter filter(shared_);
    for (std::size_t b = 0; b < active.layout.size(); ++b) {
        estimator::BlockLayout& layout = active.layout.edit()[b];
        VectorXd& gain = active.memory[memory_parts * b + gain_part];
        gain.resize(0);
        layout.shape = own_shape(active, b);
        const MatrixXd common = own_common(active, b);
        if (common.size() == 0) continue;
        // Points with the time, and multipliers by themselves: what links them is in the common errors.
        const CycleTarget& target = targets_.targets[b];
        const Index positions = target.positions ? target.points.size() : 0;
        const Index times = std::isfinite(target.time) ? 1 : 0, last = layout.shape.rows() - times;
        std::vector<Index> points, multipliers;
        for (Index k = 0; k < layout.shape.rows(); ++k)
            (k < positions || k == last ? points : multipliers).push_back(k);
        for (const std::vector<Index>& part : {points, multipliers}) {
            const MatrixXd shared = common(part, Eigen::all);
            layout.shape(part, part) -= shared * shared.transpose();
        }
        CommonErrorStep step = filter.next(common, layout.shape, layout.active);
        layout.shape = std::move(step.shape);
        gain = step.gain.reshaped();
    }
}

void CycleResidual::subtract_known(const estimator::ActiveSet& active, std::vector<estimator::BlockValue>& values,
                                   bool derivatives) const {
    CommonErrorMean known(shared_, 1 + (derivatives ? binding_.estimated_count : 0));
    for (std::size_t b = 0; b < values.size(); ++b) {
        estimator::BlockValue& value = values[b];
        const MatrixXd common = own_common(active, b);
        if (common.size() > 0 && value.status == estimator::BlockStatus::ok && value.e.size() > 0) {
            MatrixXd e(value.e.size(), 1 + value.e_theta.cols());
            e.col(0) = value.e;
            if (value.e_theta.cols() > 0) e.rightCols(value.e_theta.cols()) = value.e_theta;
            known.take_from(common, e);
            const VectorXd& gain = active.memory[memory_parts * b + gain_part];
            if (gain.size() > 0) known.learn(gain.reshaped(shared_, e.rows()), e);
            value.e = e.col(0);
            value.e_theta = e.rightCols(e.cols() - 1);
        }
        if (!active.layout[b].active) value = {};
    }
}

std::optional<VectorXd> CycleResidual::residual(const estimator::ActiveSet& active, std::size_t block,
                                                const PeriodicOrbit& orbit, const PointReadings& readings) const {
    const CycleTarget& target = targets_.targets[block];
    const Index positions = target.positions ? target.points.size() : 0;
    VectorXd e(static_cast<Index>(active.layout[block].group.size()));
    if (target.positions) e.head(positions) = map_.difference(target.points, readings.values).reshaped();
    if (std::isfinite(target.time)) e(e.size() - 1) = target.time - orbit.time;
    for (std::size_t k = 0; has_multipliers(active, block) && k < target.multipliers.size(); ++k) {
        const std::size_t m = target.multipliers[k];
        const std::size_t last = target.pair[k] ? m + 1 : m;
        if (!(last < orbit.multipliers.size())) return std::nullopt;
        // Of a measured pair the mean: it stays smooth where the model's two become real.
        const double computed =
            0.5 * (std::log(std::abs(orbit.multipliers[m])) + std::log(std::abs(orbit.multipliers[last])));
        if (!std::isfinite(computed)) return std::nullopt;
        e(positions + static_cast<Index>(k)) = target.ln_multiplier(static_cast<Index>(k)) - computed;
    }
    return e;
}

std::optional<VectorXd> CycleResidual::residual(const estimator::ActiveSet& active, std::size_t block,
                                                const PeriodicOrbit& orbit, const VectorXd& theta) const {
    const auto readings = reading_(map_.points(orbit.points), binding_.values(theta), {}, false);
    if (!readings) return std::nullopt;
    return residual(active, block, orbit, *readings);
}

std::optional<MatrixXd> CycleResidual::derivative(const estimator::ActiveSet& active, std::size_t block,
                                                  const PeriodicOrbit& orbit, const PointReadings& readings,
                                                  const VectorXd& values) const {
    const CycleTarget& target = targets_.targets[block];
    const Index n = target.points.rows();
    const Index positions = target.positions ? target.points.size() : 0;
    MatrixXd by_free(static_cast<Index>(active.layout[block].group.size()),
                     static_cast<Index>(binding_.parameter.size()));
    const MatrixXd moved = map_.points(orbit.sensitivities);
    for (Index j = 0; n * j < positions; ++j) {
        const auto slot = static_cast<std::size_t>(j);
        by_free.middleRows(n * j, n) = -(readings.by_x[slot] * moved.middleRows(n * j, n) + readings.by_free[slot]);
    }
    if (std::isfinite(target.time)) by_free.bottomRows(1) = -orbit.time_sensitivities;
    if (has_multipliers(active, block)) {
        periodic::StabilityOptions options;
        options.flow = options_.flow;
        const periodic::Stability stability =
            periodic::stability(*system_, values, map_.phase(), orbit, binding_.parameter, options);
        if (!stability.simulated) return std::nullopt;
        for (std::size_t k = 0; k < target.multipliers.size(); ++k) {
            const auto m = static_cast<Index>(target.multipliers[k]);
            const Index last = target.pair[k] ? m + 1 : m;
            by_free.row(positions + static_cast<Index>(k)) =
                -0.5 * (stability.ln_multiplier_sensitivities.row(m) + stability.ln_multiplier_sensitivities.row(last));
        }
    }
    if (!by_free.allFinite()) return std::nullopt;
    return binding_.spread(by_free);
}

}  // namespace orbid::orbits

#include "orbits/cycle_residuals/lifted_cycle_residual.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "models/arithmetic/cholesky_factor.hpp"
#include "models/arithmetic/triangular_solve.hpp"
#include "orbits/cycle_residuals/cycle_block.hpp"
#include "orbits/records/refusal.hpp"

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
    options.times = false;
    return options;
}

void check_matching(const LiftedCycleOptions& options) {
    refuse_if(!(options.matching_end > 0.0 && options.matching_end <= 1.0),
              "LiftedCycleResidual: matching_end must be in (0, 1]");
    refuse_if(!(options.matching_factor > 0.0 && options.matching_factor < 1.0),
              "LiftedCycleResidual: matching_factor must be in (0, 1)");
    refuse_if(!(options.matching_start >= 0.0), "LiftedCycleResidual: matching_start must be >= 0");
}

}  // namespace

LiftedCycleResidual::LiftedCycleResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                                         const std::vector<Cycle>& cycles, const SectionPlace& place,
                                         const VectorXd& start, const LiftedCycleOptions& options)
    : system_(std::move(system)),
      binding_(std::move(binding)),
      map_(*system_, place, options.flow),
      reading_(map_, options.targets.sensor),
      options_(options),
      targets_(select_targets(map_, binding_.values(start), binding_.parameter, cycles, points_of(options.targets))),
      scale_(target_scale(map_.coordinates(), cycles)),
      cycle_count_(cycles.size()) {
    check_matching(options);
    const Index n = map_.dimension();
    const bool factor = options.targets.weights == CycleWeights::covariance;
    VectorXd size(n);
    for (Index i = 0; i < n; ++i) {
        size(i) = factor ? 1.0 : usual_error * scale_(i);
        if (options.targets.errors.empty()) continue;
        const estimator::ErrorScale& told = options.targets.errors[static_cast<std::size_t>(i)];
        if (!told.estimate) size(i) = told.value;
    }
    estimator::Group& points = initial_.groups.emplace_back();
    points.name = "cycles.points";
    points.unit = "1";
    points.scale.estimate = false;
    points.distribution = options.points;
    for (std::size_t i = 0; i < map_.coordinates().size() && !options_.exact; ++i) {
        const models::Coordinate& coordinate = map_.coordinates()[i];
        estimator::Group& group = initial_.groups.emplace_back();
        group.name = "matching." + std::string(coordinate.name);
        group.unit = coordinate.unit;
        group.scale.estimate = false;
        group.distribution = options.matching;
    }
    for (const CycleTarget& target : targets_.targets) {
        const Index p = target.points.cols();
        estimator::BlockLayout block;
        block.label = target.label;
        block.group.assign(static_cast<std::size_t>(n * p), 0);
        if (options_.exact) {
            block.constraints = n * p;
            block.constraint_size = scale_.replicate(p, 1);
        } else {
            const std::vector<int> matching = record_groups(n, p, 1);
            block.group.insert(block.group.end(), matching.begin(), matching.end());
        }
        const VectorXd sizes = size.replicate(p, 1);
        roots_.emplace_back(sizes.asDiagonal());
        if (target.covariance.size() > 0)
            roots_.back() = sizes.asDiagonal() * models::CholeskyFactor(target.covariance).lower();
        block.latents = n * p;
        initial_.layout.edit().push_back(std::move(block));
        initial_.latents.emplace_back(target.nodes.reshaped());
    }
    const double defect = (matching_defect(initial_, start, initial_.latents).array() / scale_.array()).maxCoeff();
    initial_.memory = {VectorXd(1)};
    match_with(initial_,
               std::clamp(options.matching_start > 0.0 ? options.matching_start : defect, options.matching_end, 1.0));
}

void LiftedCycleResidual::match_with(estimator::ActiveSet& active, double matching) const {
    active.memory.front()[0] = matching;
    active.is_intermediate_stage = !options_.exact && matching > options_.matching_end;
    for (std::size_t i = 1; i < active.groups.size(); ++i)
        active.groups[i].scale.value = matching * scale_(static_cast<Index>(i) - 1);
}

estimator::RefreshReport LiftedCycleResidual::update_active_set(estimator::ActiveSet& active, const VectorXd&,
                                                                const std::vector<VectorXd>&, const VectorXd&) const {
    estimator::RefreshReport report;
    if (!active.is_intermediate_stage) return report;
    const double next = active.memory.front()[0] * options_.matching_factor;
    const bool there = next < options_.matching_end * (1.0 + 1e-9);  // but for rounding
    match_with(active, there ? options_.matching_end : next);
    report.changed = true;
    return report;
}

bool LiftedCycleResidual::evaluate_points(std::size_t block, const MatrixXd& nodes, const VectorXd& values,
                                          bool derivatives, estimator::BlockValue& value) const {
    const auto read = reading_(nodes, values, binding_.parameter, derivatives);
    if (!read) return false;
    const Index n = nodes.rows();
    const Index records = nodes.size();
    const MatrixXd& root = roots_[block];
    VectorXd missed = map_.difference(targets_.targets[block].points, read->values).reshaped();
    models::solve_lower_in_place(root, missed);
    value.e.head(records) = missed;
    if (!derivatives) return true;
    MatrixXd by_nodes = MatrixXd::Zero(records, records);
    MatrixXd by_theta(records, binding_.estimated_count);
    for (Index j = 0; j < nodes.cols(); ++j) {
        by_nodes.block(n * j, n * j, n, n) = -read->by_x[static_cast<std::size_t>(j)];
        by_theta.middleRows(n * j, n) = -binding_.spread(read->by_free[static_cast<std::size_t>(j)]);
    }
    models::solve_lower_in_place(root, by_nodes);
    models::solve_lower_in_place(root, by_theta);
    value.e_z.topRows(records) = by_nodes;
    value.e_theta.topRows(records) = by_theta;
    return true;
}

std::vector<estimator::BlockValue> LiftedCycleResidual::evaluate(const estimator::ActiveSet& active,
                                                                 const VectorXd& theta,
                                                                 const std::vector<VectorXd>& latents,
                                                                 bool derivatives) const {
    const VectorXd values = binding_.values(theta);
    return evaluate_blocks(*system_, values, active.layout, [&](std::size_t b, estimator::BlockValue& block) {
        const Index n = map_.dimension();
        const Index p = targets_.targets[b].points.cols();
        const Index records = n * p;
        const MatrixXd nodes = latents[b].reshaped(n, p);
        const Index rows = options_.exact ? records : 2 * records;
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
            defect.segment(n * j, n) = map_.difference(nodes.col(next), image->state);
            if (!derivatives) continue;
            by_theta.middleRows(n * j, n) = -binding_.spread(image->by_free);
            by_nodes.block(n * j, n * next, n, n) += MatrixXd::Identity(n, n);
            by_nodes.block(n * j, n * j, n, n) -= image->by_x;
        }
        if (options_.exact) {
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

VectorXd LiftedCycleResidual::matching_defect(const estimator::ActiveSet& active, const VectorXd& theta,
                                              const std::vector<VectorXd>& latents) const {
    const Index n = map_.dimension();
    VectorXd square = VectorXd::Zero(n);
    double count = 0.0;
    for (const estimator::BlockValue& block : evaluate(active, theta, latents, false)) {
        if (block.status != estimator::BlockStatus::ok || block.e.size() == 0) continue;
        const VectorXd all = options_.exact ? block.c : VectorXd(block.e.tail(block.e.size() / 2));
        const MatrixXd defects = all.reshaped(n, all.size() / n);
        square += defects.rowwise().squaredNorm();
        count += static_cast<double>(defects.cols());
    }
    return (square / std::max(count, 1.0)).cwiseSqrt();
}

std::vector<double> LiftedCycleResidual::distances(const estimator::ActiveSet& active, const VectorXd& theta,
                                                   const std::vector<VectorXd>& latents) const {
    const VectorXd values = binding_.values(theta);
    std::vector<double> result;
    for (std::size_t b = 0; b < active.layout.size(); ++b) {
        if (!active.layout[b].active) continue;
        const MatrixXd& points = targets_.targets[b].points;
        const auto read = reading_(latents[b].reshaped(points.rows(), points.cols()), values, {}, false);
        result.push_back(std::numeric_limits<double>::infinity());
        if (!read) continue;
        const MatrixXd apart = scale_.cwiseInverse().asDiagonal() * map_.difference(points, read->values);
        result.back() = std::sqrt(apart.squaredNorm() / static_cast<double>(apart.size()));
    }
    return result;
}

std::vector<MatrixXd> LiftedCycleResidual::nodes(const estimator::ActiveSet& active,
                                                 const std::vector<VectorXd>& latents) const {
    std::vector<MatrixXd> result(cycle_count_);
    for (std::size_t b = 0; b < active.layout.size() && b < latents.size(); ++b) {
        const MatrixXd& points = targets_.targets[b].points;
        if (active.layout[b].active && latents[b].size() == points.size())
            result[targets_.targets[b].cycle] = latents[b].reshaped(points.rows(), points.cols());
    }
    return result;
}

}  // namespace orbid::orbits

#include "orbits/cycle_residuals/one_period_residual.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "models/arithmetic/median.hpp"
#include "orbits/cycle_residuals/cycle_block.hpp"
#include "orbits/records/refusal.hpp"

namespace orbid::orbits {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Weights and scales that move by less than this change no estimate that matters.
constexpr double same_weight = 0.1;
/// Rounds of weights: 4 to 8 are usual from far off.
constexpr int most_refreshes = 15;
/// Least scale of a prediction, of the range: below it the next stage does better, and Cauchy's errors grow sharp.
constexpr double least_scale = 1e-4;
/// The median of |e| of normal errors times this is their sd.
constexpr double normal_median = 1.4826;

constexpr int sweeps = 2;  // the second sees the others near their place

std::vector<double> ladder(double start, double size) {
    std::vector<double> values;
    if (start != 0.0) {
        for (int k = -12; k <= 12; ++k)
            values.push_back(start * std::pow(2.0, k / 6.0));
    } else {
        for (const double sign : {1.0, -1.0})
            for (int k = -6; k <= 6; ++k)
                values.push_back(sign * size * std::pow(2.0, k / 2.0));
    }
    return values;
}

}  // namespace

OnePeriodResidual::OnePeriodResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                                     const std::vector<Cycle>& cycles, const SectionPlace& place, const VectorXd& start,
                                     const OnePeriodOptions& options)
    : system_(std::move(system)),
      binding_(std::move(binding)),
      map_(*system_, place, options.flow),
      reading_(map_, options.targets.sensor),
      floor_(options.floor) {
    if (!(options.floor > 0.0)) throw std::invalid_argument("OnePeriodResidual: floor must be > 0");
    CycleTargetOptions target_options = options.targets;
    target_options.weights = CycleWeights::equal;  // scales in the coordinate's unit; no covariance is needed
    target_options.positions = true;
    target_options.multipliers = false;
    target_options.times = false;
    target_options.errors.clear();
    target_options.forms.clear();
    target_options.covariances.clear();
    const VectorXd theta = binding_.values(start);
    targets_ = select_targets(map_, theta, binding_.parameter, cycles, target_options);
    initial_.groups = target_groups(map_, "one_period", target_options);
    for (estimator::Group& group : initial_.groups) {
        group.distribution = options.errors;
        group.scale = {false, 1.0, estimator::FlatPrior{}};
    }
    range_ = target_scale(map_.coordinates(), cycles);
    for (const CycleTarget& target : targets_.targets) {
        estimator::BlockLayout block;
        block.label = target.label;
        block.group = record_groups(target.points.rows(), target.points.cols(), 0);
        block.deviation.setConstant(target.points.size(), floor_);
        initial_.layout.edit().push_back(std::move(block));
        initial_.memory.emplace_back(target.nodes.reshaped());
    }
    initial_.memory.push_back(VectorXd::Zero(1));
    initial_.latents.resize(initial_.layout.size());
    initial_.is_intermediate_stage = true;
    weigh(initial_, theta);
}

Eigen::Map<const MatrixXd> OnePeriodResidual::nodes(const estimator::ActiveSet& active, std::size_t block) const {
    const Index n = map_.dimension();
    const VectorXd& states = active.memory[block];
    return {states.data(), n, states.size() / n};
}

double OnePeriodResidual::weigh(estimator::ActiveSet& active, const VectorXd& values) const {
    std::vector<double> changes;
    std::vector<std::vector<double>> sizes(static_cast<std::size_t>(range_.size()));
    for (std::size_t b = 0; b < active.layout.size(); ++b) {
        if (!active.layout[b].active) continue;
        const auto nodes = this->nodes(active, b);
        const Index n = nodes.rows();
        for (Index j = 0; j < nodes.cols(); ++j) {
            const auto image = map_(nodes.col(j), values, {}, true);
            if (!image) continue;  // as before; evaluate() will say that it cannot be predicted
            const Index next = (j + 1) % nodes.cols();
            const MatrixXd gain = range_.cwiseInverse().asDiagonal() * image->by_x * range_.asDiagonal();
            const VectorXd error = map_.difference(nodes.col(next), image->state);
            for (Index i = 0; i < n; ++i) {
                double& deviation = active.layout.edit()[b].deviation(n * next + i);
                const double now = std::hypot(floor_, gain.row(i).norm());
                changes.push_back(std::abs(std::log(now / deviation)));
                deviation = now;
                sizes[static_cast<std::size_t>(i)].push_back(std::abs(error(i)) / now);
            }
        }
    }
    if (changes.empty()) return 0.0;
    double change = models::upper_median(std::move(changes));
    for (std::size_t i = 0; i < sizes.size(); ++i) {
        double& scale = active.groups[i].scale.value;
        const double now = std::max(normal_median * models::upper_median(std::move(sizes[i])),
                                    least_scale * range_(static_cast<Index>(i)));
        change = std::max(change, std::abs(std::log(now / scale)));
        scale = now;
    }
    return change;
}

estimator::RefreshReport OnePeriodResidual::update_active_set(estimator::ActiveSet& active, const VectorXd& theta,
                                                              const std::vector<VectorXd>&, const VectorXd&) const {
    estimator::RefreshReport report;
    const VectorXd values = binding_.values(theta);
    if (!active.is_intermediate_stage) return report;
    if (in_domain(*system_, values)) {
        for (std::size_t b = 0; b < targets_.targets.size(); ++b)
            active.memory[b] = reading_.states(targets_.targets[b].points, values).reshaped();
        active.is_intermediate_stage = weigh(active, values) > same_weight;
    }
    double& updates = active.memory.back()[0];
    if (++updates >= most_refreshes) active.is_intermediate_stage = false;
    report.changed = true;
    return report;
}

std::vector<estimator::BlockValue> OnePeriodResidual::evaluate(const estimator::ActiveSet& active,
                                                               const VectorXd& theta, const std::vector<VectorXd>&,
                                                               bool derivatives) const {
    const VectorXd values = binding_.values(theta);
    return evaluate_blocks(*system_, values, active.layout, [&](std::size_t b, estimator::BlockValue& block) {
        const auto nodes = this->nodes(active, b);
        const Index n = nodes.rows();
        const Index p = nodes.cols();
        block.e.resize(n * p);
        if (derivatives) block.e_theta.resize(n * p, binding_.estimated_count);
        block.e_z.resize(n * p, 0);
        for (Index j = 0; j < p; ++j) {
            const auto image = map_(nodes.col(j), values, binding_.parameter, derivatives);
            if (!image) return false;
            const Index next = (j + 1) % p;
            block.e.segment(n * next, n) = map_.difference(nodes.col(next), image->state);
            if (derivatives) block.e_theta.middleRows(n * next, n) = -binding_.spread(image->by_free);
        }
        return true;
    });
}

double OnePeriodResidual::misfit(const VectorXd& theta) const {
    constexpr double off = 0.02;  // of the range: what a model with parameters some per cent wrong leaves
    constexpr double lost = 0.5;
    const std::vector<estimator::BlockValue> blocks = evaluate(initial_, theta, initial_.latents, false);
    double sum = 0.0;
    for (std::size_t b = 0; b < blocks.size(); ++b) {
        const std::vector<int>& group = layout()[b].group;
        for (std::size_t k = 0; k < group.size(); ++k) {
            const double e = blocks[b].status == estimator::BlockStatus::ok
                                 ? blocks[b].e(static_cast<Index>(k)) / range_(group[k])
                                 : lost;
            sum += std::log1p(e * e / (off * off));
        }
    }
    return sum;
}

VectorXd scanned_start(const OnePeriodResidual& residual, const VectorXd& start, const VectorXd& lower,
                       const VectorXd& upper, const VectorXd& size) {
    return scanned_start([&](const VectorXd& theta) { return residual.misfit(theta); }, start, lower, upper, size);
}

VectorXd scanned_start(const std::function<double(const VectorXd&)>& misfit_at, const VectorXd& start,
                       const VectorXd& lower, const VectorXd& upper, const VectorXd& size) {
    refuse_if(lower.size() != start.size() || upper.size() != start.size() || size.size() != start.size(),
              "scanned_start: start, lower, upper and size must have one value per parameter");
    VectorXd best = start;
    double best_misfit = misfit_at(best);
    for (int sweep = 0; sweep < sweeps; ++sweep)
        for (Index i = 0; i < start.size(); ++i) {
            // Both sweeps climb the ladder about the start, so that nothing runs away.
            for (const double value : ladder(start(i), size(i))) {
                if (!(value >= lower(i) && value <= upper(i))) continue;
                VectorXd trial = best;
                trial(i) = value;
                const double misfit = misfit_at(trial);
                if (!(misfit < best_misfit)) continue;
                best_misfit = misfit;
                best = trial;
            }
        }
    return best;
}

}  // namespace orbid::orbits

#include "orbits/series_residuals/prediction_residual.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "models/arithmetic/median.hpp"
#include "orbits/records/refusal.hpp"
#include "orbits/simulation/section_map.hpp"

namespace orbid::orbits {

using Eigen::Index;
using Eigen::VectorXd;

namespace {

/// Share of a prediction's error that does not come from its start, as a variance: what is left where nothing is
/// amplified.
constexpr double own_variance = 0.01;

}  // namespace

PredictionResidual::PredictionResidual(std::vector<std::shared_ptr<const models::System>> systems,
                                       models::ParameterBinding binding, std::vector<Transition> transitions,
                                       models::Clock clock, const VectorXd& start, PredictionOptions options)
    : systems_(std::move(systems)),
      binding_(std::move(binding)),
      transitions_(std::move(transitions)),
      clock_(clock),
      options_(std::move(options)) {
    const auto require = [](bool rule, const std::string& message) {
        refuse_if(!rule, "prediction residual: {}", message);
    };
    require(!systems_.empty() && systems_.front() != nullptr, "a system is needed");
    refuse_record_if(transitions_.empty(), "prediction residual: the record has no two successive states");
    require(start.size() == binding_.estimated_count,
            fmt::format("start has {} entries, must have {}", start.size(), binding_.estimated_count));
    const Index n = systems_.front()->dimension();
    if (options_.sizes.size() == 0) options_.sizes = VectorXd::Ones(n);
    require(options_.sizes.size() == n && (options_.sizes.array() > 0.0).all(),
            "sizes must be > 0, one per coordinate of the model");
    for (const Transition& t : transitions_)
        require(t.from.size() == n && t.to.size() == n && t.duration > 0.0, "a transition of wrong shape or duration");
    for (const models::Coordinate& coordinate : systems_.front()->coordinates()) {
        estimator::Group group;
        group.name = fmt::format("{}.{}", options_.name, coordinate.name);
        group.unit = coordinate.unit;
        group.scale.value = 0.0;  // from the residuals
        group.distribution = estimator::StudentErrors{{false, 1.0, estimator::FlatPrior{}}};
        initial_.groups.push_back(std::move(group));
    }
    for (std::size_t first = 0; first < transitions_.size(); first += block_size) {
        const std::size_t last = std::min(first + block_size, transitions_.size());
        estimator::BlockLayout block;
        block.label = fmt::format("transitions {} to {}", first, last - 1);
        for (std::size_t t = first; t < last; ++t)
            for (Index i = 0; i < n; ++i)
                block.group.push_back(static_cast<int>(i));
        block.deviation = VectorXd::Ones(std::ssize(block.group));
        initial_.layout.edit().push_back(std::move(block));
    }
    initial_.latents.resize(initial_.layout.size());
    initial_.memory = {VectorXd::Zero(1)};
    initial_.is_intermediate_stage = true;
    amplify(initial_, start);
}

double PredictionResidual::amplify(estimator::ActiveSet& active, const VectorXd& theta) const {
    const VectorXd& sizes = options_.sizes;
    const std::span<const Index> none;
    const auto made =
        predictions(systems_, binding_.values(theta), transitions_, none, clock_, options_.flow, options_.delay);
    std::vector<double> changes;
    for (std::size_t t = 0; t < made.size(); ++t) {
        if (!made[t].ok) continue;  // as before
        for (Index i = 0; i < sizes.size(); ++i) {
            const double grown = made[t].by_x.row(i).transpose().cwiseProduct(sizes).norm() / sizes[i];
            const double now = std::sqrt(own_variance + grown * grown);
            double& deviation = active.layout.edit()[t / block_size].deviation[record(t, i)];
            changes.push_back(std::abs(std::log(now / deviation)));
            deviation = now;
        }
    }
    return models::upper_median(std::move(changes));
}

std::vector<estimator::BlockValue> PredictionResidual::evaluate(const estimator::ActiveSet& active,
                                                                const VectorXd& theta, const std::vector<VectorXd>&,
                                                                bool derivatives) const {
    const std::optional<std::span<const Index>> free =
        derivatives ? std::optional<std::span<const Index>>(binding_.parameter) : std::nullopt;
    const auto made =
        predictions(systems_, binding_.values(theta), transitions_, free, clock_, options_.flow, options_.delay);
    const Index n = options_.sizes.size();
    std::vector<estimator::BlockValue> values(active.layout.size());
    for (std::size_t b = 0; b < values.size(); ++b) {
        if (!active.layout[b].active) continue;
        estimator::BlockValue& value = values[b];
        const auto records = std::ssize(active.layout[b].group);
        value.e.resize(records);
        if (derivatives) {
            value.e_theta = Eigen::MatrixXd::Zero(records, binding_.estimated_count);
            value.e_z.resize(records, 0);
        }
        Index lost = 0;
        for (Index k = 0; k * n < records; ++k) {
            const Prediction& prediction = made[b * block_size + static_cast<std::size_t>(k)];
            if (!prediction.ok) ++lost;
            value.e.segment(k * n, n) = prediction.ok ? prediction.error : options_.sizes;
            if (derivatives && prediction.ok) value.e_theta.middleRows(k * n, n) = -binding_.spread(prediction.by_free);
        }
        if (2 * lost * n > records) value.status = estimator::BlockStatus::failed;
    }
    return values;
}

estimator::RefreshReport PredictionResidual::update_active_set(estimator::ActiveSet& active, const VectorXd& theta,
                                                               const std::vector<VectorXd>&, const VectorXd&) const {
    constexpr double settled = 0.02;  // of a weight: no estimate moves with that
    constexpr int enough = 8;
    constexpr int rough = 3;  // rounds that are minimised roughly
    estimator::RefreshReport report;
    double& rounds = active.memory.front()[0];
    if (rounds >= enough) return report;
    ++rounds;
    active.is_intermediate_stage = rounds < rough;
    report.changed = amplify(active, theta) > settled;
    return report;
}

double PredictionResidual::misfit(const VectorXd& theta) const {
    constexpr double off = 0.02;  // of the sizes: what a model with parameters some per cent wrong leaves
    const auto made = predictions(systems_, binding_.values(theta), transitions_, std::nullopt, clock_, options_.flow,
                                  options_.delay);
    double sum = 0.0;
    std::size_t count = 0;
    for (std::size_t t = 0; t < made.size(); ++t) {
        const VectorXd& deviation = layout()[t / block_size].deviation;
        for (Index i = 0; i < options_.sizes.size(); ++i, ++count) {
            const double e = made[t].ok ? made[t].error[i] / (options_.sizes[i] * deviation[record(t, i)]) : 1.0;
            sum += std::log1p(e * e / (off * off));
        }
    }
    return count > 0 ? sum / static_cast<double>(count) : 0.0;
}

}  // namespace orbid::orbits

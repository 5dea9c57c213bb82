#include "identification/starts/whole_segments.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include <fmt/format.h>

#include "identification/problem/problem_residuals.hpp"

namespace orbid::identification {

namespace {

using Index = Eigen::Index;

/// Of a whole segment of a chaotic record no first state is known well enough. At seven Lyapunov times errors have
/// grown e^7 times; a course that begins with errors of 1 % of the attractor's size has long lost the record.
constexpr double most_growth = 1e3;

constexpr std::size_t least_readings = 20;

/// Fewer samples are hardly enough for nodes, and seldom chaotic.
constexpr Index least_samples = 50;

/// A share of the spread of a coordinate that a model with some truth in it does not leave.
constexpr double most_left = 0.5;

/// The largest derivative of some readings by each component of the first state, over their root mean square.
Eigen::VectorXd largest_effects(const estimator::BlockValue& value, const Eigen::VectorXd& observed,
                                std::vector<Index>::const_iterator begin, std::vector<Index>::const_iterator end) {
    Eigen::VectorXd largest = Eigen::VectorXd::Zero(value.e_z.cols());
    double squares = 0.0;
    for (auto i = begin; i != end; ++i) {
        largest = largest.cwiseMax(value.e_z.row(*i).transpose().cwiseAbs());
        squares += observed[*i] * observed[*i];
    }
    const double size = std::sqrt(squares / static_cast<double>(end - begin));
    if (!(size > 0.0)) return Eigen::VectorXd::Zero(value.e_z.cols());
    return largest / size;
}

double growth_of_block(const orbits::SeriesResidual& residual, std::size_t block, const estimator::BlockValue& value) {
    if (value.status != estimator::BlockStatus::ok || value.e_z.cols() == 0) return 0.0;
    const auto& records = residual.records(block);
    const Eigen::VectorXd& observed = residual.readings(block);
    std::map<Index, std::vector<Index>> rows;  // of each coordinate, in the order of time
    for (std::size_t i = 0; i < records.size(); ++i)
        if (records[i].sample >= 0) rows[records[i].coordinate].push_back(static_cast<Index>(i));
    Eigen::VectorXd early = Eigen::VectorXd::Zero(value.e_z.cols());
    Eigen::VectorXd late = early;
    for (const auto& [coordinate, list] : rows) {
        if (list.size() < least_readings) continue;
        const auto tenth = static_cast<std::ptrdiff_t>(list.size() / 10);
        early = early.cwiseMax(largest_effects(value, observed, list.cbegin(), list.cbegin() + tenth));
        late = late.cwiseMax(largest_effects(value, observed, list.cend() - tenth, list.cend()));
    }
    double growth = 0.0;
    for (Index j = 0; j < early.size(); ++j)
        if (early[j] > 0.0 && std::isfinite(late[j])) growth = std::max(growth, late[j] / early[j]);
    return growth;
}

/// The error of each group, as a share of the spread of its readings.
double largest_share_left(const orbits::SeriesResidual& residual, const estimator::Estimate& estimate) {
    double largest = 0.0;
    for (std::size_t g = 0; g < residual.groups().size(); ++g) {
        const std::string& name = residual.groups()[g].name;
        const auto scale = std::find_if(estimate.scales.begin(), estimate.scales.end(),
                                        [&](const estimator::EstimatedScale& one) { return one.group == name; });
        if (scale == estimate.scales.end()) continue;
        std::vector<double> readings;
        for (std::size_t b = 0; b < residual.layout().size(); ++b)
            for (std::size_t i = 0; i < residual.layout()[b].group.size(); ++i)
                if (residual.layout()[b].group[i] == static_cast<int>(g))
                    readings.push_back(residual.readings(b)[static_cast<Index>(i)]);
        const auto all = Eigen::Map<const Eigen::ArrayXd>(readings.data(), std::ssize(readings));
        const double spread = std::sqrt((all - all.mean()).square().mean());
        if (spread > 0.0) largest = std::max(largest, scale->rms / spread);
    }
    return largest;
}

}  // namespace

double error_growth(const orbits::SeriesResidual& residual, const Eigen::VectorXd& theta) {
    const auto values = residual.evaluate(residual.initial_set(), theta, residual.initial_latents(), true);
    double growth = 0.0;
    for (std::size_t b = 0; b < values.size(); ++b)
        growth = std::max(growth, growth_of_block(residual, b, values[b]));
    return growth;
}

std::string divide_where_errors_grow(IdentificationProblem& problem) {
    if (!problem.series || problem.series->interval || !problem.series->unless_errors_grow) return {};
    EstimateSetup setup = estimate_setup(problem, fitted_labels(problem));
    ProblemResiduals residuals;
    add_series(problem, setup, residuals);
    for (std::size_t i = 0; i < residuals.series.size(); ++i) {
        const double growth = error_growth(*residuals.series[i], setup.start());
        if (!(growth > most_growth)) continue;
        problem.series->interval = SeriesChoice::automatic_interval;
        return fmt::format(
            "{}: at the start errors of the first state grow {:.0e} times along a segment, which no course in one "
            "piece can follow: the series has nodes, as with \"interval\": \"auto\"",
            problem.experiments[residuals.experiments[i]].name, growth);
    }
    return {};
}

bool may_need_nodes(const IdentificationProblem& problem, const std::vector<Stage>& strategy) {
    if (!problem.series || problem.series->interval || !problem.series->unless_errors_grow) return false;
    if (strategy.size() != 1 || !strategy.front().is_series()) return false;
    return std::all_of(problem.series->data.begin(), problem.series->data.end(), [&](std::size_t index) {
        const Experiment& data = problem.experiments[index];
        const auto segments = data.fitted_segments();
        return std::all_of(segments.begin(), segments.end(), [&](std::size_t segment) {
            return data.series->segments[segment].values.cols() >= least_samples;
        });
    });
}

std::string need_of_nodes(const StrategyRun& strategy) {
    if (!strategy.best || !strategy.best->succeeded()) return fmt::format("status {}", status_name(strategy.last));
    double left = 0.0;
    for (const auto& residual : strategy.best->residuals.series)
        left = std::max(left, largest_share_left(*residual, strategy.best->estimate));
    if (left > most_left) return fmt::format("{:.0f} % of the spread of the readings is left", 100.0 * left);
    return {};
}

}  // namespace orbid::identification

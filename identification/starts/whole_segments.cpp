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

}  // namespace

double error_growth(const orbits::SeriesResidual& residual, const Eigen::VectorXd& theta) {
    const auto values = residual.evaluate(residual.initial_set(), theta, residual.initial_latents(), true);
    double growth = 0.0;
    for (std::size_t b = 0; b < values.size(); ++b)
        growth = std::max(growth, growth_of_block(residual, b, values[b]));
    return growth;
}

std::string unbearable_growth(const IdentificationProblem& problem, const ProblemResiduals& residuals,
                              const Eigen::VectorXd& theta) {
    for (std::size_t i = 0; i < residuals.series.size(); ++i)
        if (const double growth = error_growth(*residuals.series[i], theta); growth > most_growth)
            return fmt::format("{}: errors of the first state grow {:.0e} times along a segment",
                               problem.experiments[residuals.experiments[i]].name, growth);
    return {};
}

std::string divide_where_errors_grow(IdentificationProblem& problem) {
    if (!problem.series || problem.series->interval || !problem.series->unless_errors_grow) return {};
    EstimateSetup setup = estimate_setup(problem, fitted_labels(problem));
    ProblemResiduals residuals;
    add_series(problem, setup, residuals);
    const std::string growth = unbearable_growth(problem, residuals, setup.start());
    if (growth.empty()) return {};
    problem.series->interval = SeriesChoice::automatic_interval;
    return growth +
           " at the start, which no course in one piece can follow: the series has nodes, as with \"interval\": "
           "\"auto\"";
}

}  // namespace orbid::identification

#include "identification/stages/series_doubt.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <vector>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include "identification/problem/estimated_values.hpp"
#include "models/arithmetic/median.hpp"
#include "orbits/series_residuals/continuity_report.hpp"

namespace orbid::identification {

namespace {

using Eigen::Index;

/// With more than this left, in sds, a minimisation has stopped short of its minimum.
constexpr double most_left = 0.1;
/// Share of intervals that may miss the next node beyond what errors of matching explain.
constexpr double unmatched_share = 0.01;
/// Correlation in succession. What nodes with matching of their own absorb makes it negative.
constexpr double most_correlation = 0.1, most_negative = 0.4, normal_limit = 5.0;
/// Residuals over the range of what is read: integration alone leaves more than errors do.
constexpr double nothing_left = 1e-8;
/// Of a correlation by chance: where it may be as large as this, too few pairs were found to tell.
constexpr double largest_limit = 0.4;
constexpr Index queried = 2048, compared = 65536, apart = 10;
/// Samples after a node of which residuals are compared.
constexpr Index followed = 16;

/// Fewer samples are hardly enough for nodes, and seldom chaotic.
constexpr Index least_samples = 50;

/// A share of the spread of a coordinate that a model with some truth in it does not leave.
constexpr double most_unexplained = 0.5;

double distance2(const StateResiduals& readings, Index i, Index j) {
    double sum = 0.0;
    for (Index d = 0; d < readings.states.rows(); ++d) {
        double r = readings.states(d, i) - readings.states(d, j);
        if (readings.angle[static_cast<std::size_t>(d)] != 0) r -= std::nearbyint(r);
        sum += r * r;
    }
    return sum;
}

/// The nearest of every `stride`-th state, `apart` or farther in the record; -1: none.
Index nearest(const StateResiduals& readings, Index i, Index stride) {
    double best = std::numeric_limits<double>::infinity();
    Index found = -1;
    for (Index j = 0; j < readings.states.cols(); j += stride) {
        if (std::abs(i - j) < apart) continue;
        const double other = distance2(readings, i, j);
        if (other >= best) continue;
        best = other;
        found = j;
    }
    return found;
}

/// The nodes of a series, and what is left of the readings of one group from each to the next.
StateResiduals residuals_of(const models::System& system, const orbits::ShootingResidual& series,
                            const std::vector<estimator::BlockValue>& values,
                            const std::vector<Eigen::VectorXd>& latents, int group) {
    const orbits::ShootingPlan& plan = series.plan();
    const Index n = system.dimension();
    std::vector<std::size_t> used;
    for (std::size_t b = 0; b < values.size(); ++b)
        if (values[b].e.size() > 0 && latents[b].size() >= n) used.push_back(b);
    const Index interval = std::min(series.interval(), followed);
    Eigen::VectorXd scale = series.range();
    for (Index d = 0; d < n; ++d)
        if (system.coordinates()[static_cast<std::size_t>(d)].angle) scale[d] = 2.0 * std::numbers::pi;
    StateResiduals result;
    result.states.resize(n, std::ssize(used));
    result.residual = Eigen::MatrixXd::Constant(interval, std::ssize(used), std::numeric_limits<double>::quiet_NaN());
    for (Index k = 0; k < std::ssize(used); ++k) {
        const std::size_t b = used[static_cast<std::size_t>(k)];
        result.states.col(k) = latents[b].head(n).cwiseQuotient(scale);
        const auto readings = plan.of(b);
        for (std::size_t r = 0; r < readings.size(); ++r) {
            const Index after = readings[r].sample - plan.nodes[b].sample;
            // Of two readings of an angle, one after the other, the first is enough.
            if (readings[r].group != group || after >= interval || std::isfinite(result.residual(after, k))) continue;
            result.residual(after, k) = values[b].e[static_cast<Index>(r)] / readings[r].deviation;
        }
    }
    for (const models::Coordinate& coordinate : system.coordinates())
        result.angle.push_back(coordinate.angle ? 1 : 0);
    return result;
}

/// What is against the residuals of one group of readings.
std::string doubt_of_readings(const orbits::ShootingResidual& series, const estimator::EstimatedScale& scale,
                              const StateResiduals& readings, std::size_t group) {
    if (scale.rms <= nothing_left * series.reading_range(group)) return {};
    const double chance = normal_limit / std::sqrt(static_cast<double>(scale.count));
    if (scale.lag1 > std::max(most_correlation, chance) || scale.lag1 < -std::max(most_negative, chance))
        return fmt::format("residuals of {} follow each other (correlation {:.2f})", scale.group, scale.lag1);
    const NeighbourCorrelation found = neighbour_correlation(readings);
    if (found.limit > largest_limit) return fmt::format("too few readings of {} to tell", scale.group);
    if (!(found.value <= std::max(most_correlation, found.limit)))
        return fmt::format("residuals of {} depend on the state (correlation {:.2f} of neighbours)", scale.group,
                           found.value);
    return {};
}

/// What is against the links from node to node.
std::string doubt_of_links(const orbits::ShootingResidual& series, const estimator::ActiveSet& active,
                           const estimator::Estimate& estimate, const std::vector<Eigen::VectorXd>& latents) {
    const auto report = orbits::matching_report(series, active, estimated_theta(estimate), latents);
    const double count = std::max(1.0, static_cast<double>(report.defect.count));
    if (static_cast<double>(report.defect.large) / count > report.expected + unmatched_share)
        return fmt::format("{} of {} intervals miss the next node", report.defect.large, report.defect.count);
    const double worst = (report.defect.rms.array() / series.range().array()).maxCoeff();
    if (worst > series.noise(active)) return "intervals miss the next node by more than readings err";
    return {};
}

/// What is left of the readings of each group, as a share of their spread: the largest. Both in the unit of the
/// readings, whatever the law of their errors.
double largest_share_left(const orbits::SeriesResidual& residual, const std::vector<estimator::BlockValue>& values) {
    struct Sums {
        double count = 0.0, mean = 0.0, spread = 0.0, left = 0.0;
    };
    std::vector<Sums> sums(residual.groups().size());
    for (std::size_t b = 0; b < values.size(); ++b) {
        const Eigen::VectorXd& readings = residual.readings(b);
        const std::vector<int>& group = residual.layout()[b].group;
        for (Index i = 0; i < values[b].e.size(); ++i) {
            Sums& own = sums[static_cast<std::size_t>(group[static_cast<std::size_t>(i)])];
            own.count += 1.0;
            const double off = readings[i] - own.mean;
            own.mean += off / own.count;
            own.spread += off * (readings[i] - own.mean);  // Welford's sum
            own.left += values[b].e[i] * values[b].e[i];
        }
    }
    double largest = 0.0;
    for (const Sums& own : sums)
        if (own.spread > 0.0) largest = std::max(largest, std::sqrt(own.left / own.spread));
    return largest;
}

}  // namespace

NeighbourCorrelation neighbour_correlation(const StateResiduals& readings) {
    const Index count = readings.states.cols();
    std::vector<double> sizes;
    for (const double e : readings.residual.reshaped())
        if (std::isfinite(e)) sizes.push_back(std::abs(e));
    const double size = 1.4826 * models::upper_median(sizes);
    if (count <= 2 * apart || !(size > 0.0)) return {};
    constexpr double cut = 3.0;
    const auto u = [&](Index k, Index i) { return std::clamp(readings.residual(k, i) / size, -cut, cut); };
    double mean = 0.0, square = 0.0;
    for (Index i = 0; i < count; ++i)
        for (Index k = 0; k < readings.residual.rows(); ++k) {
            if (!std::isfinite(readings.residual(k, i))) continue;
            mean += u(k, i);
            square += u(k, i) * u(k, i);
        }
    mean /= static_cast<double>(sizes.size());
    const double variance = square / static_cast<double>(sizes.size()) - mean * mean;
    const Index stride = (count + compared - 1) / compared, step = std::max<Index>(1, count / queried);
    std::vector<Index> partner(static_cast<std::size_t>((count + step - 1) / step));
    tbb::parallel_for(std::size_t{0}, partner.size(),
                      [&](std::size_t k) { partner[k] = nearest(readings, static_cast<Index>(k) * step, stride); });
    double sum = 0.0, pairs = 0.0;
    for (std::size_t p = 0; p < partner.size(); ++p) {
        const Index i = static_cast<Index>(p) * step, j = partner[p];
        for (Index k = 0; j >= 0 && k < readings.residual.rows(); ++k) {
            if (!std::isfinite(readings.residual(k, i) + readings.residual(k, j))) continue;
            sum += (u(k, i) - mean) * (u(k, j) - mean);
            pairs += 1.0;
        }
    }
    if (!(pairs > 0.0) || !(variance > 0.0)) return {};
    return {sum / pairs / variance, normal_limit * std::sqrt(2.0 / pairs)};
}

std::string series_doubt(const models::System& system, const StageRun& run) {
    const estimator::Estimate& estimate = run.estimate;
    if (estimate.status != estimator::EstimateStatus::converged)
        return fmt::format("it is {}", estimator::name(estimate.status));
    if (estimate.remaining >= most_left) return fmt::format("{:.2g} sds are left to go", estimate.remaining);
    const auto& series = run.residuals.shooting;
    if (series.empty() || run.residuals.all().size() != series.size() || !run.is_evaluated() ||
        estimate.latents.size() != series.size())
        return "it has no nodes";
    for (const estimator::ResidualCount& count : estimate.counts)
        if (count.lost + count.rejected > 0 || !count.unused.empty()) return "not all readings are used";
    for (std::size_t i = 0; i < series.size(); ++i) {
        const orbits::ShootingResidual& one = *series[i];
        if (std::string doubt = doubt_of_links(one, estimate.active[i], estimate, estimate.latents[i]); !doubt.empty())
            return doubt;
        for (std::size_t g = 0; g < one.reading_groups(); ++g) {
            const auto* scale = scale_of(estimate, one.groups()[g].name);
            if (scale == nullptr) return "its errors have no scale";
            const StateResiduals left =
                residuals_of(system, one, estimate.residuals[i], estimate.latents[i], static_cast<int>(g));
            if (std::string doubt = doubt_of_readings(one, *scale, left, g); !doubt.empty()) return doubt;
        }
    }
    return {};
}

std::string group_without_errors(const StageRun& run) {
    for (const auto& series : run.residuals.shooting)
        for (std::size_t g = 0; g < series->reading_groups(); ++g) {
            const auto* scale = scale_of(run.estimate, series->groups()[g].name);
            if (scale != nullptr && scale->estimated && scale->count > 0 &&
                scale->rms <= nothing_left * series->reading_range(g))
                return scale->group;
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

std::string whole_segments_doubt(const StageRun& run) {
    if (!run.succeeded()) return fmt::format("status {}", status_name(run.estimate.status));
    double left = 0.0;
    for (std::size_t i = 0; i < run.residuals.series.size(); ++i)
        left = std::max(left, largest_share_left(*run.residuals.series[i], run.estimate.residuals[i]));
    if (left > most_unexplained) return fmt::format("{:.0f} % of the spread of the readings is left", 100.0 * left);
    return {};
}

}  // namespace orbid::identification

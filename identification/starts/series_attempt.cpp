#include "identification/starts/series_attempt.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <variant>

#include <fmt/format.h>

#include "identification/problem/estimated_values.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/records/reading_noise.hpp"

namespace orbid::identification {

namespace {

/// Whether the residuals of the readings are those of independent errors, as large as readings scatter about a smooth
/// course, and no two intervals are left apart.
bool explains(const IdentificationProblem& problem, std::size_t place, const orbits::ShootingResidual& residual,
              const estimator::Estimate& estimate) {
    constexpr double most_excess = 1.25, least_correlation = 0.1, normal_limit = 5.0;
    const Experiment& data = problem.experiments[problem.series->data[place]];
    if (residual.defect(estimate.active[place], estimated_theta(estimate), estimate.latents[place]).large > 0)
        return false;
    const bool difference = data.sensor.type == models::Sensor::Type::angle_difference;
    for (const estimator::Group& group : residual.groups()) {
        const auto* scale = scale_of(estimate, group.name);
        if (scale == nullptr || !group.ordered || !(scale->count > 0)) continue;
        const auto count = static_cast<double>(scale->count);
        if (std::abs(scale->lag1) > std::max(least_correlation, normal_limit / std::sqrt(count))) return false;
        const std::string coordinate = group.name.substr(group.name.rfind('.') + 1);
        const orbits::Series& series = *data.series;
        Eigen::Index row = -1;
        for (Eigen::Index i = 0; i < series.dimension(); ++i)
            if (series.coordinate(i).name == coordinate) row = i;
        const Eigen::Index index = problem.system->coordinate_index(coordinate);
        if (row < 0 || index < 0 || difference) continue;
        const bool angle =
            models::reads_angle(data.sensor, problem.system->coordinates(), static_cast<std::size_t>(index));
        double noise = 0.0;
        for (const std::size_t s : residual.fitted())
            noise = std::max(noise, orbits::reading_noise(series.segments[s].values.row(row).transpose(), angle));
        if (noise > 0.0 && scale->rms > most_excess * noise) return false;
    }
    return true;
}

/// What readings miss and what links miss in a sampling interval, each as the mean of ln(rms) in units of the ranges.
/// Links are no better than exact matching can be.
double misfit_of(const ProblemResiduals& residuals, const estimator::Estimate& estimate) {
    double sum = 0.0;
    for (std::size_t i = 0; i < residuals.shooting.size(); ++i) {
        const orbits::ShootingResidual& one = *residuals.shooting[i];
        const double least = orbits::sampled_tightness * one.noise(estimate.active[i]);
        const double intervals = std::sqrt(static_cast<double>(one.interval()));
        const auto links = static_cast<std::size_t>(one.range().size());
        const std::size_t readings = one.groups().size() - links;
        for (std::size_t g = 0; g < one.groups().size(); ++g) {
            const auto* scale = scale_of(estimate, one.groups()[g].name);
            if (scale == nullptr) continue;
            const bool link = g >= readings;
            const double size = link ? one.range()[static_cast<Eigen::Index>(g - readings)] : one.reading_range(g);
            const double rms = scale->rms / size;
            sum +=
                std::log(link ? std::max(rms / intervals, least) : rms) / static_cast<double>(link ? links : readings);
        }
    }
    return std::isfinite(sum) ? sum : std::numeric_limits<double>::infinity();
}

/// A flow of an interval that takes more steps than this goes where no start belongs.
std::size_t most_flow_steps(const SeriesStart& start) {
    constexpr std::size_t most = 2000, least = 200, per_sample = 100;
    std::size_t longest = 0;
    for (const std::size_t interval : start.intervals) {
        if (interval == SeriesChoice::automatic_interval) return most;
        longest = std::max(longest, interval);
    }
    return start.intervals.empty() ? most : std::min(most, least + per_sample * longest);
}

/// All stages are behind it, and only steps are missing.
bool is_on_its_way(const estimator::Estimate& estimate) {
    return estimate.status == estimator::EstimateStatus::iteration_limit && !estimate.parameters.empty() &&
           std::none_of(estimate.active.begin(), estimate.active.end(),
                        [](const estimator::ActiveSet& one) { return one.is_intermediate_stage; });
}

}  // namespace

std::vector<estimator::FreeParameter> held_near(std::vector<estimator::FreeParameter> parameters,
                                                const std::vector<estimator::JointNormalPrior>& joint_priors,
                                                double width) {
    for (estimator::FreeParameter& one : parameters)
        if (std::holds_alternative<estimator::FlatPrior>(one.prior) && one.tied_to.empty() && one.start != 0.0 &&
            !in_joint_prior(joint_priors, one.name))
            one.prior = estimator::NormalPrior{one.start, width * std::abs(one.start)};
    return parameters;
}

SeriesAttempt SeriesAttempts::make(const std::string& name, const SeriesStart& start) {
    constexpr int most_steps = 45;
    constexpr double rough = 1e-2;
    constexpr double prior_width = 0.5;
    const models::FlowOptions quick_flow{1e-11, 1e-11, most_flow_steps(start)};
    SeriesAttempt result;
    ProblemResiduals residuals;
    const std::uint64_t before = followed_.work;
    try {
        add_shooting(problem_, setup_, start, residuals, quick_flow, &followed_);
    } catch (const orbits::DataError&) {
        work_ += followed_.work - before;
        throw;
    }
    work_ += followed_.work - before;
    std::vector<estimator::FreeParameter> near = held_near(parameters_, problem_.joint_priors, prior_width);
    for (std::size_t i = 0; i < near.size(); ++i)
        near[i].start = start.theta[static_cast<Eigen::Index>(i)];
    estimator::EstimateOptions options = search_.estimate;
    options.variance = estimator::Variance::ml;
    options.verdict = false;
    options.error_uncertainties = false;
    options.maximum_iterations = most_steps;
    options.step_tolerance = rough;
    const auto spent = [&] {
        std::uint64_t sum = work_;
        for (const auto& one : residuals.shooting)
            sum += one->work();
        return sum;
    };
    options.interrupted = [&] {
        const std::uint64_t now = spent();
        result.cut = now > most_work_ || now - work_ > most_of_one_;
        return result.cut || (search_.estimate.interrupted && search_.estimate.interrupted());
    };
    options.watched = [&](const estimator::StepReport& report) {
        if (search_.watched) search_.watched(name, report);
        if (search_.reached && !reached_) search_.reached(report.theta);
    };
    result.estimate = estimator::estimate(near, residuals.all(), {}, options);
    if (is_on_its_way(result.estimate)) go_on(near, residuals, options, result.estimate);
    work_ = spent();
    const estimator::Estimate& found = result.estimate;
    const bool whole = found.status != estimator::EstimateStatus::failed && !found.parameters.empty() &&
                       found.latents.size() == residuals.shooting.size();
    if (!whole) return result;
    reached_ = true;
    result.start = nodes_at(residuals, found);
    for (std::size_t i = 0; i < residuals.shooting.size(); ++i)
        result.start.reading_sds.push_back(reading_sds(i, *residuals.shooting[i], found));
    result.misfit = misfit_of(residuals, found);
    result.start.follows = found.status != estimator::EstimateStatus::interrupted;
    for (std::size_t i = 0; i < residuals.shooting.size() && result.start.follows; ++i)
        result.start.follows =
            !found.active[i].is_intermediate_stage && explains(problem_, i, *residuals.shooting[i], found);
    return result;
}

SeriesAttempt SeriesAttempts::with_signs_of_start(SeriesAttempt found) {
    std::vector<Eigen::VectorXd> flipped;
    Eigen::VectorXd all = found.start.theta;
    for (std::size_t i = 0; i < parameters_.size(); ++i) {
        const auto k = static_cast<Eigen::Index>(i);
        if (!parameters_[i].tied_to.empty() || !(parameters_[i].start * all[k] < 0.0)) continue;
        all[k] = -all[k];
        flipped.push_back(found.start.theta);
        flipped.back()[k] = all[k];
    }
    if (flipped.size() > 1) flipped.insert(flipped.begin(), all);
    for (const Eigen::VectorXd& theta : flipped) {
        SeriesStart start = found.start;
        start.theta = theta;
        SeriesAttempt other = make("signs of the start", start);
        if (other.start.follows && changed_signs(other) < changed_signs(found)) return other;
    }
    return found;
}

SeriesAttempt SeriesAttempts::on_better_sides(SeriesAttempt found) {
    constexpr int rounds = 4;
    constexpr std::uint64_t most_repairs = 3;  // times the work of attempts: a course on wrong sides is nearly right
    for (int round = 0; round < rounds && !search_.signs.empty(); ++round) {
        if (!found.has_ended() || found.start.nodes.empty() || !std::isfinite(found.misfit)) break;
        if (repair_work_ / most_repairs > most_work_) break;
        const models::FlowOptions quick_flow{1e-11, 1e-11, most_flow_steps(found.start)};
        const CourseRepair repair = repaired_course(problem_, setup_, parameters_, search_.signs, found.start,
                                                    found.estimate, search_.estimate, {quick_flow, most_of_one_ / 8});
        repair_work_ += repair.work;
        if (repair.changed == 0) break;
        SeriesAttempt other = make("other sides", repair.start);
        const bool better = other.misfit < found.misfit || (other.start.follows && !found.start.follows);
        if (search_.log)
            search_.log(fmt::format("the other side suits {} places better: {}, {} iterations, misfit {:.4g}{}{}",
                                    repair.changed, estimator::name(other.estimate.status), other.estimate.iterations,
                                    other.misfit, other.start.follows ? ": explains the readings" : "",
                                    better ? "" : ", not taken"));
        other.estimate.iterations += found.estimate.iterations;
        other.estimate.evaluations += found.estimate.evaluations;
        if (!better) break;
        found = std::move(other);
    }
    return found;
}

/// How many parameters have another sign than at their start.
std::ptrdiff_t SeriesAttempts::changed_signs(const SeriesAttempt& one) const {
    std::ptrdiff_t count = 0;
    for (std::size_t i = 0; i < parameters_.size(); ++i)
        count += parameters_[i].start * one.start.theta[static_cast<Eigen::Index>(i)] < 0.0 ? 1 : 0;
    return count;
}

/// Goes on from where an attempt has come to.
void SeriesAttempts::go_on(std::vector<estimator::FreeParameter> near, ProblemResiduals& residuals,
                           const estimator::EstimateOptions& options, estimator::Estimate& estimate) const {
    for (std::size_t i = 0; i < residuals.shooting.size(); ++i) {
        const orbits::ShootingResidual& one = *residuals.shooting[i];
        residuals.shooting[i] = std::make_unique<orbits::ShootingResidual>(
            one.with(one.matching(), estimate.active[i], estimate.latents[i], estimated_theta(estimate)));
    }
    for (std::size_t i = 0; i < near.size(); ++i)
        near[i].start = estimate.parameters[i].value;
    const int iterations = estimate.iterations, evaluations = estimate.evaluations;
    estimate = estimator::estimate(near, residuals.all(), {}, options);
    estimate.iterations += iterations;
    estimate.evaluations += evaluations;
}

/// By observed coordinate; empty where two of them share an error.
std::vector<double> SeriesAttempts::reading_sds(std::size_t place, const orbits::ShootingResidual& residual,
                                                const estimator::Estimate& estimate) const {
    const auto readings = std::ssize(residual.groups()) - residual.range().size();
    std::vector<double> sds;
    if (readings != std::ssize(problem_.experiments[problem_.series->data[place]].observe)) return sds;
    for (std::ptrdiff_t g = 0; g < readings; ++g) {
        const auto* scale = scale_of(estimate, residual.groups()[static_cast<std::size_t>(g)].name);
        sds.push_back(scale != nullptr && !scale->factor ? scale->value : 0.0);
    }
    return sds;
}

}  // namespace orbid::identification

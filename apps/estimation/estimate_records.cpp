#include "apps/estimation/estimate_records.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/orbits_job.hpp"
#include "estimator/interface/not_finite.hpp"
#include "identification/problem/estimated_values.hpp"
#include "models/system/stopped.hpp"

namespace orbid::apps {

using identification::estimated_theta;
using identification::scale_of;

namespace {

/// Relative part of a group's errors; 0 where there is none.
double relative_of(const estimator::EstimatedScale& scale) {
    for (const estimator::Estimated& parameter : scale.shape)
        if (parameter.name == "relative") return parameter.value;
    return 0.0;
}

/// Phase [rad] of the k-th point of a cycle; of a map the number of the iteration, of a plane that of the crossing.
double at_section(const Workspace& work, Eigen::Index k) {
    const auto count = static_cast<double>(k);
    if (work.system().kind() != models::Kind::forced) return count;
    return work.job.section_phase + 2.0 * std::numbers::pi * count;
}

double nearest_prediction(double observed, double e, bool angle) {
    const double predicted = observed - e;
    return angle ? models::wrapped(predicted) : predicted;
}

}  // namespace

void add_cycle_rows(const Workspace& work, const orbits::CycleResidual& residual, const estimator::ActiveSet& active,
                    const orbits::CycleSearch& search, const estimator::Estimate& estimate,
                    const std::vector<estimator::BlockValue>& values, std::vector<ResidualRow>& rows) {
    const std::vector<models::Coordinate>& coordinates = residual.coordinates();
    const auto n = static_cast<Eigen::Index>(coordinates.size());
    const std::string experiment = work.job.orbits->file ? std::string() : work.job.data[work.job.orbits->data].name;
    for (std::size_t b = 0; b < values.size(); ++b) {
        if (values[b].e.size() == 0) continue;
        const orbits::Cycle& cycle = search.cycles[residual.cycle_of(b)];
        const auto& layout = active.layout[b];
        Eigen::Index position = 0;  // points come first, coordinate fastest
        for (Eigen::Index i = 0; i < values[b].e.size(); ++i) {
            const auto& group = residual.groups()[static_cast<std::size_t>(layout.group[static_cast<std::size_t>(i)])];
            const auto* scale = scale_of(estimate, group.name);
            const double shape = layout.shape.size() > 0 ? std::sqrt(layout.shape(i, i)) : 1.0;
            const double sd = scale != nullptr ? scale->value * shape : estimator::nan_value;
            const std::string label = fmt::format("cycle {}", residual.cycle_of(b));
            if (group.name == "cycles.ln_multiplier") {
                const double ln_multiplier = residual.target(b).ln_multiplier[i - position];
                rows.push_back({experiment, label, "ln_multiplier", at_section(work, 0), ln_multiplier,
                                ln_multiplier - values[b].e[i], sd});
                continue;
            }
            if (group.name == "cycles.time") {
                rows.push_back(
                    {experiment, label, "time", at_section(work, 0), cycle.time, cycle.time - values[b].e[i], sd});
                continue;
            }
            const auto& coordinate = coordinates[static_cast<std::size_t>(position % n)];
            const double observed = cycle.points(position % n, position / n);
            rows.push_back({experiment, label, std::string(coordinate.name), at_section(work, position / n), observed,
                            nearest_prediction(observed, values[b].e[i], coordinate.angle), sd});
            ++position;
        }
    }
}

void add_series_rows(const Workspace& work, std::size_t experiment, const orbits::SeriesResidual& residual,
                     const estimator::Estimate& estimate, const std::vector<estimator::BlockValue>& values,
                     std::vector<ResidualRow>& rows) {
    const Job& job = work.job;
    const auto asking = work.asking();
    const auto& series = residual.series();
    for (std::size_t b = 0; b < values.size(); ++b) {
        models::stop_if_asked(asking);
        if (values[b].e.size() == 0) continue;
        const auto& segment = series.segments[residual.segment(b)];
        const auto& records = residual.records(b);
        for (Eigen::Index i = 0; i < values[b].e.size(); ++i) {
            const auto& record = records[static_cast<std::size_t>(i)];
            if (record.sample < 0) continue;
            const auto& coordinate = job.model.coordinate(record.coordinate);
            Eigen::Index row = 0;
            while (series.coordinates[static_cast<std::size_t>(row)].name != coordinate.name)
                ++row;
            const auto& group =
                residual.groups()[static_cast<std::size_t>(residual.layout()[b].group[static_cast<std::size_t>(i)])];
            const auto* scale = scale_of(estimate, group.name);
            const double observed = segment.values(row, record.sample);
            rows.push_back({job.data[experiment].name, segment.label, std::string(coordinate.name),
                            segment.times[record.sample], observed, observed - values[b].e[i],
                            scale != nullptr
                                ? residual.error_sd(b, i, values[b].e[i], scale->value, relative_of(*scale))
                                : estimator::nan_value});
        }
    }
}

void add_shooting_rows(const Workspace& work, std::size_t experiment, const orbits::ShootingResidual& residual,
                       const estimator::Estimate& estimate, const std::vector<estimator::BlockValue>& values,
                       std::vector<ResidualRow>& rows) {
    const Job& job = work.job;
    const auto asking = work.asking();
    const orbits::Series& series = residual.series();
    const orbits::ShootingPlan& plan = residual.plan();
    const bool forced = job.model.is(models::Kind::forced);
    for (std::size_t b = 0; b < values.size(); ++b) {
        models::stop_if_asked(asking);
        if (values[b].e.size() == 0) continue;
        const orbits::PlannedNode& node = plan.nodes[b];
        const orbits::Segment& segment = series.segments[node.segment];
        const auto readings = plan.of(b);
        for (std::size_t r = 0; r < readings.size(); ++r) {
            const orbits::PlannedReading& reading = readings[r];
            const auto& coordinate = job.model.coordinate(reading.coordinate);
            const auto count = static_cast<double>(reading.sample);
            double at = forced ? series.phase + 2.0 * std::numbers::pi * count : count;
            if (segment.times.size() > 0) at = segment.times[reading.sample];
            const auto* scale = scale_of(estimate, residual.groups()[static_cast<std::size_t>(reading.group)].name);
            rows.push_back({job.data[experiment].name, segment.label, std::string(coordinate.name), at, reading.value,
                            reading.value - values[b].e[static_cast<Eigen::Index>(r)],
                            scale != nullptr ? scale->value * reading.deviation : estimator::nan_value});
        }
    }
}

void add_branch_rows(const Workspace& work, const periodic::BranchResidual& residual,
                     const estimator::Estimate& estimate, const std::vector<estimator::BlockValue>& values,
                     std::vector<ResidualRow>& rows) {
    const Eigen::Index parameter = work.job.estimate->branch->parameter;
    for (std::size_t b = 0; b < values.size(); ++b) {
        if (values[b].e.size() == 0) continue;
        const periodic::MeasuredOrbit& orbit = residual.orbits()[b];
        const auto sources = residual.sources(b);
        for (std::size_t r = 0; r < sources.size(); ++r) {
            const std::string& group = residual.groups()[sources[r]].name;
            const auto* scale = scale_of(estimate, group);
            const auto c = static_cast<Eigen::Index>(sources[r]);
            const double known =
                orbit.deviations.size() > 0 && residual.channels()[sources[r]].known_sds ? orbit.deviations[c] : 1.0;
            const double observed = orbit.values[c];
            const double predicted = observed - values[b].e[static_cast<Eigen::Index>(r)];
            double sd = scale != nullptr ? scale->value * known : estimator::nan_value;
            if (std::holds_alternative<estimator::LogNormalErrors>(residual.channels()[sources[r]].distribution))
                sd *= std::abs(predicted);
            if (scale != nullptr) sd = std::hypot(sd, relative_of(*scale) * predicted);
            rows.push_back({"branch", orbit.label, group.substr(group.find('.') + 1), orbit.binding.base[parameter],
                            observed, predicted, sd});
        }
        if (!residual.moves_parameter()) continue;
        const double at = orbit.binding.base[parameter];
        rows.push_back({"branch", orbit.label, std::string(work.job.model.parameter(parameter).name), at, at,
                        at - values[b].e[static_cast<Eigen::Index>(sources.size())],
                        residual.groups().back().scale.value});
    }
}

void add_branch_states(const periodic::BranchResidual& residual, const estimator::ActiveSet& active,
                       const Eigen::VectorXd& theta, ResultContext& context) {
    const auto orbits = residual.solutions(active, theta);
    for (std::size_t b = 0; b < orbits.size(); ++b) {
        SteadyState state;
        state.experiment = "branch";
        state.segment = residual.orbits()[b].label;
        state.used = active.layout[b].active;
        state.orbit = orbits[b];
        context.steady_states.push_back(std::move(state));
    }
}

void add_first_nodes(const Job& job, std::size_t experiment, const orbits::ShootingResidual& residual,
                     const std::vector<Eigen::VectorXd>& latents, const std::vector<Eigen::VectorXd>& sds,
                     ResultContext& context) {
    const auto coordinates = job.model.system->coordinates();
    const auto& nodes = residual.plan().nodes;
    for (std::size_t b = 0; b < latents.size() && b < nodes.size(); ++b) {
        if (b > 0 && nodes[b - 1].segment == nodes[b].segment) continue;
        InitialState initial{job.data[experiment].name, residual.series().segments[nodes[b].segment].label, {}};
        for (Eigen::Index i = 0; i < latents[b].size(); ++i) {
            const auto& coordinate = coordinates[static_cast<std::size_t>(i)];
            const bool known = b < sds.size() && sds[b].size() == latents[b].size();
            initial.values.push_back({std::string(coordinate.name), std::string(coordinate.unit), latents[b][i],
                                      known ? sds[b][i] : estimator::nan_value, true});
        }
        context.initial_states.push_back(std::move(initial));
    }
}

void add_initial_states(const Job& job, std::size_t experiment, const orbits::SeriesResidual& residual,
                        const estimator::Estimate& estimate, const std::vector<std::vector<Eigen::Index>>& parameters,
                        const std::vector<Eigen::VectorXd>& latents, const std::vector<Eigen::VectorXd>& sds,
                        ResultContext& context) {
    const auto coordinates = job.model.system->coordinates();
    for (std::size_t b = 0; b < latents.size(); ++b) {
        InitialState initial{job.data[experiment].name, residual.series().segments[residual.segment(b)].label, {}};
        const Eigen::VectorXd state = residual.state(b, estimated_theta(estimate), latents[b]);
        for (Eigen::Index i = 0; i < state.size(); ++i) {
            const auto& free = residual.free_coordinates();
            const auto at = std::find(free.begin(), free.end(), i);
            const bool known = b < sds.size() && sds[b].size() == static_cast<Eigen::Index>(free.size());
            double sd = at != free.end() && known ? sds[b][at - free.begin()] : estimator::nan_value;
            const auto& own = parameters[static_cast<std::size_t>(i)];
            if (!own.empty()) sd = estimate.parameters[static_cast<std::size_t>(own[b])].sd;
            const auto& coordinate = coordinates[static_cast<std::size_t>(i)];
            initial.values.push_back({std::string(coordinate.name), std::string(coordinate.unit), state[i], sd,
                                      at != free.end() || !own.empty()});
        }
        context.initial_states.push_back(std::move(initial));
    }
}

namespace {

/// Readings of a segment that was not fitted. Where errors have no sd of their own for all readings none is given.
void add_predicted_rows(const identification::IdentificationProblem& problem, const identification::Experiment& data,
                        const orbits::SeriesResidual& residual, const estimator::Estimate& estimate,
                        const orbits::SegmentPrediction& prediction, std::vector<ResidualRow>& rows) {
    const orbits::Segment& segment = residual.series().segments[prediction.segment];
    std::vector<double> sds;
    for (const estimator::Group& group : residual.groups()) {
        const auto* scale = scale_of(estimate, group.name);
        const bool one = scale != nullptr && !scale->factor && relative_of(*scale) == 0.0;
        sds.push_back(one ? scale->value : estimator::nan_value);
    }
    for (const auto& reading : prediction.readings) {
        const auto channel = static_cast<std::size_t>(reading.channel);
        rows.push_back({data.name, segment.label, std::string(problem.coordinate(data.observe[channel]).name),
                        segment.times[reading.sample], reading.value, reading.value - reading.error, sds[channel]});
    }
}

}  // namespace

void add_predictions(const identification::IdentificationProblem& problem, std::size_t experiment,
                     const orbits::SeriesResidual& residual, const estimator::Estimate& estimate,
                     const Eigen::VectorXd& theta, bool with_fitted, ResultContext& context,
                     std::vector<ResidualRow>& rows) {
    const identification::Experiment& data = problem.experiments[experiment];
    std::vector<std::size_t> segments;
    if (with_fitted) segments = data.fitted_segments();
    const auto fitted = segments.size();
    const auto predicted = data.segments_with(data.predict);
    segments.insert(segments.end(), predicted.begin(), predicted.end());
    Eigen::VectorXd scales(static_cast<Eigen::Index>(residual.groups().size()));
    Eigen::VectorXd relative = Eigen::VectorXd::Zero(scales.size());
    for (Eigen::Index g = 0; g < scales.size(); ++g) {
        const auto* scale = scale_of(estimate, residual.groups()[static_cast<std::size_t>(g)].name);
        scales[g] = scale != nullptr && scale->value > 0.0 ? scale->value : 1.0;
        if (scale != nullptr) relative[g] = relative_of(*scale);
    }
    const auto predictions = residual.predict(theta, scales, segments, relative);
    for (std::size_t i = 0; i < predictions.size(); ++i) {
        Prediction prediction;
        prediction.experiment = data.name;
        prediction.segment = residual.series().segments[predictions[i].segment].label;
        prediction.normalised_rms = predictions[i].normalised_rms;
        prediction.fitted = i < fitted;
        prediction.readings.assign(data.observe.size(), 0);
        for (const auto& reading : predictions[i].readings)
            ++prediction.readings[static_cast<std::size_t>(reading.channel)];
        for (Eigen::Index c = 0; c < predictions[i].rms.size(); ++c) {
            const Eigen::Index coordinate = data.observe[static_cast<std::size_t>(c)];
            prediction.rms.emplace_back(problem.coordinate(coordinate).name, predictions[i].rms[c]);
        }
        if (!prediction.fitted) add_predicted_rows(problem, data, residual, estimate, predictions[i], rows);
        context.predictions.push_back(std::move(prediction));
    }
}

}  // namespace orbid::apps

#include "apps/program/check/flow_rate.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <optional>

#include <fmt/format.h>

#include "apps/estimation/job_problem.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/evaluated_model.hpp"
#include "apps/job/orbits_job.hpp"
#include "apps/job/periodic_job.hpp"
#include "apps/program/check/point_time.hpp"
#include "apps/stages/periodic_stage.hpp"
#include "apps/stages/state_size.hpp"
#include "identification/problem/problem_residuals.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/simulation/virtual_experiment.hpp"

namespace orbid::apps {

namespace {

constexpr Eigen::Index most_points = 4096;
constexpr Eigen::Index most_simulated = 65536;
/// Segments of which one may begin near a fixed point, where nothing grows yet.
constexpr std::size_t most_looked_at = 4;
/// Trajectories that flow together; more fill no register.
constexpr std::size_t most_together = 16;

/// The job with one experiment, of which one segment is fitted by single shooting.
Job alone(const Job& job, std::size_t index, const std::string& label) {
    Job one = job;
    one.data = {job.data[index]};
    one.data[0].fit = std::vector<std::string>{label};
    one.data[0].predict.clear();
    one.estimate->series->data = {0};
    one.estimate->series->interval.reset();
    one.estimate->cycles.reset();
    one.estimate->waveform.reset();
    one.estimate->branch.reset();
    one.orbits = {};
    return one;
}

orbits::Segment first_part(const orbits::Segment& segment, Eigen::Index count) {
    orbits::Segment part = segment;
    part.values = segment.values.leftCols(count);
    if (segment.times.size() > count) part.times = segment.times.head(count);
    if (segment.deviations.size() > 0) part.deviations = segment.deviations.leftCols(count);
    return part;
}

/// The job's simulation with this many points, without its transient.
orbits::VirtualExperimentOptions simulation_of(const Job& job, const DataJob& data, std::size_t count) {
    orbits::VirtualExperimentOptions options;
    const SimulationJob& run = *data.simulation;
    if (run.sampling == orbits::Series::Sampling::section) {
        orbits::SectionPlan plan;
        plan.sections = count;
        plan.transient = 0;
        plan.section = job_section(job);
        options.plan = plan;
        options.trajectories = std::min(run.trajectories, count);
    } else {
        options.plan = orbits::SamplePlan{run.step, count, 0};
        options.trajectories = std::min(run.trajectories, most_together);
    }
    const auto given = std::min(run.initial.size(), options.trajectories);
    if (given > 0) options.initial.resize(job.model.system->dimension(), static_cast<Eigen::Index>(given));
    for (std::size_t i = 0; i < given; ++i)
        options.initial.col(static_cast<Eigen::Index>(i)) = run.initial[i];
    options.phase = job.section_phase;
    options.sensor = data.sensor;
    options.noise = run.noise;
    options.seed = job.seed;
    return options;
}

/// Trajectories as the job simulates them.
Experiment simulated_beginning(const Job& job, const DataJob& data) {
    const LabelledInputs inputs = load_inputs(job, data);
    auto made = orbits::simulate(
        *system_with(job, inputs), data.with_own(job.model.values),
        simulation_of(job, data, std::min<std::size_t>(data.simulation->count, static_cast<std::size_t>(most_points))));
    if (!made.complete) throw orbits::DataError(fmt::format("cannot be simulated: {}", made.message));
    Experiment experiment;
    experiment.series = std::move(made.series);
    experiment.inputs = by_segment(inputs, experiment.series.segments);
    return experiment;
}

/// The first segments of a record that take part in the fit, and their inputs.
std::optional<Experiment> fitted_beginning(const Job& job, std::size_t index, const DataCheck& check) {
    const DataJob& data = job.data[index];
    if (!data.simulation && index >= check.experiments.size()) return std::nullopt;
    Experiment all = data.simulation ? simulated_beginning(job, data) : check.experiments[index];
    Experiment chosen = all;
    chosen.series.segments.clear();
    chosen.inputs.clear();
    const auto& labels = data.fit ? *data.fit : data.predict;
    for (std::size_t s = 0; s < all.series.segments.size() && chosen.series.segments.size() < most_looked_at; ++s) {
        const bool named = std::find(labels.begin(), labels.end(), all.series.segments[s].label) != labels.end();
        if (named != data.fit.has_value() || all.series.segments[s].values.cols() < 8) continue;
        chosen.series.segments.push_back(std::move(all.series.segments[s]));
        if (s < all.inputs.size()) chosen.inputs.push_back(all.inputs[s]);
    }
    return chosen;
}

/// Median size of the derivatives of some readings after the initial state.
double typical_size(const Eigen::MatrixXd& e_z, Eigen::Index from, Eigen::Index count) {
    const Eigen::VectorXd sizes = e_z.middleRows(from, count).rowwise().norm();
    std::vector<double> list(sizes.begin(), sizes.end());
    const auto middle = list.begin() + std::ssize(list) / 2;
    std::nth_element(list.begin(), middle, list.end());
    return *middle;
}

/// Whether a small change of the initial state keeps growing: by e^5 from the first eighth of the readings to the last,
/// and by e^2 from one half to the other. (A phase that drifts grows by 3 there, the jumps of a relaxation oscillation
/// do not grow.)
bool is_chaotic(const estimator::BlockValue& value, Eigen::Index readings) {
    if (value.e_z.cols() == 0 || readings < 64 || value.e_z.rows() < readings) return false;
    const Eigen::Index part = readings / 8, half = readings / 2;
    const double first = typical_size(value.e_z, 0, part), last = typical_size(value.e_z, readings - part, part);
    const double sooner = typical_size(value.e_z, 0, half), later = typical_size(value.e_z, half, readings - half);
    return last > std::exp(5.0) * first && later > std::exp(2.0) * sooner;
}

/// An evaluation of the first readings of a segment with all derivatives, sensors and inputs included.
/// @return why it fails; empty: it does not
std::string evaluate_beginning(const Job& one, Experiment part, const std::function<bool()>& late, double& took,
                               bool& chaotic) {
    auto problem = identification_problem(one, {&part, 1});
    problem.system = problem.system->with_stop(late);
    auto setup = estimate_setup(problem, fitted_labels(problem));
    identification::ProblemResiduals residuals;
    add_series(problem, setup, residuals);
    const orbits::SeriesResidual& residual = *residuals.series.front();
    const auto set = residual.initial_set();
    const double begun = processor_seconds();
    const auto values = residual.evaluate(set, setup.start(), set.latents, true);
    took = processor_seconds() - begun;
    if (values.front().status != estimator::BlockStatus::ok) return "the model cannot be followed from its start";
    const auto& list = residual.records(0);
    // Of the first coordinate, in the order of time.
    const auto other = std::find_if(list.begin(), list.end(), [&](const auto& reading) {
        return reading.coordinate != list.front().coordinate || reading.sample < 0;
    });
    chaotic = is_chaotic(values.front(), other - list.begin());
    return {};
}

void measure_series(const Job& job, std::size_t index, const DataCheck& check, FlowRate& rate) {
    const std::optional<Experiment> record = fitted_beginning(job, index, check);
    if (!record || record->series.segments.empty()) return;
    bool chaotic = false;
    const auto evaluated = [&](std::size_t k, Eigen::Index most) {
        const orbits::Segment& segment = record->series.segments[k];
        const Job one = alone(job, index, segment.label);
        return seconds_per_point(
            std::min(segment.values.cols(), most),
            [&](Eigen::Index count, const std::function<bool()>& late, double& took) {
                Experiment part = *record;
                part.series.segments = {first_part(segment, count)};
                if (!part.inputs.empty()) part.inputs = {record->inputs[k]};
                return evaluate_beginning(one, std::move(part), late, took, chaotic);
            },
            rate.unknown);
    };
    rate.derivatives = evaluated(0, most_points);
    if (!rate.unknown.empty()) return;
    const auto free = static_cast<double>(job.estimate->parameters.size() + job.model.system->coordinates().size());
    rate.value = rate.derivatives / (1.0 + 0.5 * free);
    if (job.estimate->series->interval) return;
    // Whether errors grow shows over the whole of a segment, as far as there is time to look.
    const double affordable = std::clamp(measured_for_s / rate.derivatives, 64.0, 1e9);
    for (std::size_t k = 0; !chaotic && k < record->series.segments.size(); ++k)
        (void)evaluated(k, static_cast<Eigen::Index>(affordable));
    if (chaotic)
        rate.unknown = "the record is chaotic and not divided (\"interval\"): how many steps a fit takes depends on it";
}

/// Of trajectories as they are simulated.
void measure_simulation(const Job& job, std::size_t index, FlowRate& rate) {
    const DataJob& data = job.data[index];
    const SimulationJob& run = *data.simulation;
    const bool sampled = run.sampling == orbits::Series::Sampling::samples;
    const LabelledInputs inputs = load_inputs(job, data);
    const auto system = system_with(job, inputs);
    const Eigen::VectorXd theta = data.with_own(job.model.values);
    rate.value = seconds_per_point(
        static_cast<Eigen::Index>(
            std::min(sampled ? run.count : run.sections, static_cast<std::size_t>(most_simulated))),
        [&](Eigen::Index count, const std::function<bool()>& late, double& took) -> std::string {
            auto options = simulation_of(job, data, static_cast<std::size_t>(count));
            options.interrupted = late;
            const double begun = processor_seconds();
            const auto made = orbits::simulate(*system->with_stop(late), theta, options);
            took = (processor_seconds() - begun) / (sampled ? static_cast<double>(options.trajectories) : 1.0);
            return made.complete ? std::string() : fmt::format("it cannot be simulated: {}", made.message);
        },
        rate.unknown);
}

}  // namespace

std::vector<FlowRate> measured_rates(const Job& asked, const DataCheck& data) {
    Job job = asked;
    // As a run would; what has to be compiled first is measured as it is interpreted.
    if (!is_compiled_first(job)) (void)settle_evaluation(job);
    job.model.system = job.model.system->with_state_size(state_size(job, data.experiments));
    std::vector<FlowRate> rates(job.data.size());
    for (std::size_t i = 0; i < job.data.size(); ++i) {
        FlowRate& rate = rates[i];
        const DataJob& own = job.data[i];
        const bool sampled = own.sampling() == orbits::Series::Sampling::samples;
        const bool fitted = job.estimate && job.estimate->series &&
                            std::count(job.estimate->series->data.begin(), job.estimate->series->data.end(), i) > 0;
        try {
            if (sampled && fitted) measure_series(job, i, data, rate);
            if (own.simulation && rate.unknown.empty() && job.model.system->inputs().empty())
                measure_simulation(job, i, rate);
        } catch (const orbits::DataError& error) {
            rate.unknown = error.what();
        }
    }
    return rates;
}

}  // namespace orbid::apps

#include "apps/program/check/flow_check.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include <fmt/format.h>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/flow_stepper.hpp"
#include "apps/job/periodic_job.hpp"
#include "apps/results/counted_noun.hpp"
#include "apps/results/summary_table.hpp"
#include "apps/stages/data_stage.hpp"
#include "apps/stages/recorded_series.hpp"
#include "apps/stages/state_size.hpp"
#include "models/trajectories/odeint/odeint_kernel.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/simulation/initial_state.hpp"
#include "orbits/simulation/virtual_experiment.hpp"

namespace orbid::apps {

namespace {

/// More starts than these tell nothing new; a chaotic flow costs some ten milliseconds each.
constexpr std::size_t most_starts = 3;
constexpr std::size_t columns_shown = 6;

struct Start {
    Eigen::VectorXd state;
    double phase;
};

/// Durations, and what they are in words.
struct Span {
    models::Clock clock;
    std::vector<double> durations;
    std::string over;
};

/// The first readings of the records that files hold. What is wrong with a file is told where the data are checked.
void add_readings(const models::System& system, const Job& job, const Eigen::VectorXd& theta,
                  std::vector<Start>& starts) {
    for (std::size_t i = 0; i < job.data.size(); ++i) {
        if (!job.data[i].file || job.data[i].streamed()) continue;
        try {
            const orbits::Series series = recorded_series(job, i);
            std::vector<Eigen::Index> rows;
            for (const orbits::SeriesCoordinate& coordinate : series.coordinates)
                rows.push_back(system.coordinate_index(coordinate.name));
            for (const orbits::Segment& segment : series.segments)
                if (starts.size() < most_starts)
                    starts.push_back(
                        {orbits::initial_state(system, theta, {segment, rows, job.data[i].sensor, series.phase}),
                         series.phase});
        } catch (const orbits::DataError&) {
            continue;
        }
    }
}

std::vector<Start> starts_of(const models::System& system, const Job& job, const Eigen::VectorXd& theta) {
    std::vector<Start> starts;
    const auto add = [&](const Eigen::VectorXd& state) {
        if (starts.size() < most_starts && state.size() == system.dimension() && state.allFinite())
            starts.push_back({state, job.section_phase});
    };
    for (const DataJob& data : job.data)
        if (data.simulation) std::for_each(data.simulation->initial.begin(), data.simulation->initial.end(), add);
    if (job.periodic)
        for (const OrbitStart& orbit : job.periodic->orbits)
            if (orbit.points.cols() > 0) add(orbit.points.col(0));
    if (job.estimate && job.estimate->waveform)
        for (const auto& experiment : job.estimate->waveform->experiments)
            if (experiment.start.cols() > 0) add(experiment.start.col(0));
    if (starts.empty()) add_readings(system, job, theta, starts);
    std::erase_if(starts, [](const Start& start) { return !start.state.allFinite(); });
    if (!starts.empty()) return starts;
    // Inside the range that trajectories reach, positive: populations are.
    constexpr double probed_s = 20.0;
    const Eigen::VectorXd range =
        orbits::typical_range(system, theta, job.section_phase, probed_s, job.seed, {1e-6, 1e-6, 100000});
    for (std::size_t k = 0; k < most_starts; ++k) {
        Eigen::VectorXd state = range;
        for (Eigen::Index i = 0; i < state.size(); ++i)
            state[i] *= 0.3 + 0.25 * std::sin(1.0 + static_cast<double>(i) + 2.0 * static_cast<double>(k));
        add(state);
    }
    return starts;
}

Span span_of(const models::System& system, const Job& job) {
    constexpr std::array parts{1.0, 2.0, 3.0};
    const auto times = [&](double unit) {
        std::vector<double> durations;
        for (const double part : parts)
            durations.push_back(part * unit);
        return durations;
    };
    if (system.kind() == models::Kind::forced)
        return {models::Clock::phase, times(2.0 * std::numbers::pi), "3 periods of the forcing"};
    for (const DataJob& data : job.data)
        if (data.simulation && data.simulation->step > 0.0)
            return {models::Clock::time, times(10.0 * data.simulation->step), "30 sampling intervals"};
    for (std::size_t i = 0; i < job.data.size(); ++i) {
        if (!job.data[i].file || job.data[i].streamed()) continue;
        try {
            for (const orbits::Segment& segment : recorded_series(job, i).segments)
                if (segment.times.size() > 1 && segment.times[1] > segment.times[0])
                    return {models::Clock::time, times(segment.times[1] - segment.times[0]), "3 sampling intervals"};
        } catch (const orbits::DataError&) {
            continue;
        }
    }
    if (job.periodic)
        for (const OrbitStart& orbit : job.periodic->orbits)
            if (orbit.time > 0.0)
                return {models::Clock::time, times(orbit.time / 3.0), fmt::format("{:.3g} s", orbit.time)};
    return {models::Clock::time, times(1.0), "3 s"};
}

/// Entries of one kind over all flows: the largest of each, and their largest differences.
class Comparison {
public:
    Comparison(Eigen::Index rows, Eigen::Index columns)
        : largest_(Eigen::MatrixXd::Zero(rows, columns)), difference_(Eigen::MatrixXd::Zero(rows, columns)) {}

    void add(const Eigen::MatrixXd& own, const Eigen::MatrixXd& other) {
        largest_ = largest_.cwiseMax(own.cwiseAbs()).cwiseMax(other.cwiseAbs());
        difference_ = difference_.cwiseMax((own - other).cwiseAbs());
    }
    [[nodiscard]] Eigen::MatrixXd relative() const {
        return (largest_.array() > 0.0).select(difference_.array() / largest_.array(), 0.0);
    }

private:
    Eigen::MatrixXd largest_, difference_;
};

}  // namespace

FlowCheck check_flows(const Job& job) {
    auto own = models::system_without_odeint(*job.model.system);
    if (!own) {
        if (const std::string why = odeint_refusal(job); !why.empty()) throw std::invalid_argument(why);
        own = job.model.system;
    }
    const double size = state_size(job, {});
    const auto other = models::odeint_system(*own)->with_state_size(size);
    own = own->with_state_size(size);
    const Eigen::VectorXd theta = starting_parameters(job);
    std::vector<Eigen::Index> free;
    if (job.estimate)
        for (const FreeParameterJob& one : job.estimate->parameters)
            if (std::find(free.begin(), free.end(), one.parameter) == free.end()) free.push_back(one.parameter);
    const bool all = free.empty();
    for (Eigen::Index i = 0; all && i < theta.size(); ++i) {
        // A dry friction of 0 has a derivative that jumps.
        Eigen::VectorXd moved = theta;
        moved[i] += own->parameters()[static_cast<std::size_t>(i)].typical_size;
        if (own->smooth(moved)) free.push_back(i);
    }
    FlowCheck check;
    for (const models::Coordinate& coordinate : own->coordinates())
        check.directions.emplace_back(coordinate.name);
    for (const Eigen::Index i : free)
        check.directions.emplace_back(own->parameters()[static_cast<std::size_t>(i)].name);
    const Span span = span_of(*own, job);
    const models::FlowOptions options;
    check.over = span.over;
    check.tolerance = options.relative_tolerance;
    const Eigen::Index n = own->dimension(), d = n + std::ssize(free);
    Comparison comparison(n, 1 + d);
    for (const Start& start : starts_of(*own, job, theta)) {
        const auto run = [&](const models::System& system) {
            return system.flow_with_sensitivities(start.state, start.phase, span.durations, theta, free, span.clock,
                                                  options);
        };
        const auto a = run(*own), b = run(*other);
        if (a.status != models::FlowStatus::ok || b.status != models::FlowStatus::ok) {
            ++check.failed;
            check.failure = fmt::format("{}: {}", a.status != models::FlowStatus::ok ? "verner" : "odeint",
                                        models::description(a.status != models::FlowStatus::ok ? a.status : b.status));
            continue;
        }
        ++check.starts;
        check.own_steps += a.steps;
        check.odeint_steps += b.steps;
        for (Eigen::Index k = 0; k < std::ssize(span.durations); ++k) {
            const auto entries = [&](const models::FlowResult& flow) {
                Eigen::MatrixXd values(n, 1 + d);
                values << flow.states.col(k), flow.sensitivity(k, d);
                return values;
            };
            comparison.add(entries(a), entries(b));
        }
    }
    check.differences = comparison.relative();
    return check;
}

std::string flow_table(const Job& job, const FlowCheck& check) {
    const auto coordinates = job.model.system->coordinates();
    const bool wide = coordinates.size() <= columns_shown;
    std::vector<SummaryTable::Column> columns{left_aligned("")};
    for (std::size_t i = 0; wide && i < coordinates.size(); ++i)
        columns.push_back({std::string(coordinates[i].name)});
    if (!wide) {
        columns.push_back({"largest"});
        columns.push_back(left_aligned("of"));
    }
    SummaryTable table(columns);
    for (Eigen::Index j = 0; check.starts > 0 && j < check.differences.cols(); ++j) {
        SummaryTable::Row cells{
            j == 0 ? "value"
                   : "by " + std::string(static_cast<std::size_t>(j) <= coordinates.size() ? "the start's " : "") +
                         check.directions[static_cast<std::size_t>(j - 1)]};
        Eigen::Index worst = 0;
        (void)check.differences.col(j).maxCoeff(&worst);
        for (Eigen::Index i = 0; wide && i < check.differences.rows(); ++i)
            cells.push_back(fmt::format("{:.1e}", check.differences(i, j)));
        if (!wide) {
            cells.push_back(fmt::format("{:.1e}", check.differences(worst, j)));
            cells.emplace_back(std::string(coordinates[static_cast<std::size_t>(worst)].name));
        }
        table.add(std::move(cells));
    }
    std::string text = fmt::format(
        "flows by \"verner\" and \"odeint\": largest differences relative to each entry, {} over {}, tolerance "
        "{:.0e}\n",
        counted(check.starts, "start"), check.over, check.tolerance);
    text += table.text();
    if (check.starts > 0) text += fmt::format("  steps: verner {}, odeint {}\n", check.own_steps, check.odeint_steps);
    if (check.failed > 0)
        text +=
            fmt::format("  {} could not be followed to the end ({})\n", counted(check.failed, "start"), check.failure);
    return text;
}

}  // namespace orbid::apps

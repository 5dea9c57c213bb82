#include "identification/problem/problem_waveform.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <utility>

#include <fmt/format.h>

#include "estimator/interface/not_finite.hpp"
#include "identification/problem/cycle_orbits.hpp"
#include "models/definition/parameter.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/sections/record_period.hpp"

namespace orbid::identification {

namespace {

using Eigen::Index;

std::string block_label(const IdentificationProblem& problem, const orbits::Series& series, std::size_t experiment,
                        std::size_t segment) {
    const std::string& name = problem.experiments[experiment].name;
    return series.segments.size() > 1 ? fmt::format("{}, segment {}", name, series.segments[segment].label) : name;
}

/// The row of a series with the readings of a coordinate of the model.
std::optional<Index> series_row(const IdentificationProblem& problem, const orbits::Series& series, Index coordinate) {
    const auto at = std::find_if(
        series.coordinates.begin(), series.coordinates.end(),
        [&](const orbits::SeriesCoordinate& one) { return one.name == problem.coordinate(coordinate).name; });
    if (at == series.coordinates.end()) return std::nullopt;
    return at - series.coordinates.begin();
}

/// Values and known sds of the observed coordinates; a coordinate that is not observed there is missing.
void take_readings(const IdentificationProblem& problem, const Experiment& data, const orbits::Series& series,
                   std::size_t segment, periodic::WaveformRecord& record) {
    const auto& errors = problem.waveform->errors;
    const orbits::Segment& from = series.segments[segment];
    const Index count = from.values.cols();
    record.times = from.times;
    record.values = Eigen::MatrixXd::Constant(std::ssize(errors), count, estimator::nan_value);
    const bool sds = std::any_of(errors.begin(), errors.end(), [](const auto& e) { return !e.sd_column.empty(); });
    if (sds) record.deviations = record.values;
    for (std::size_t c = 0; c < errors.size(); ++c) {
        if (std::count(data.observe.begin(), data.observe.end(), errors[c].coordinate) == 0) continue;
        const auto row = series_row(problem, series, errors[c].coordinate);
        if (!row)
            throw orbits::DataError(fmt::format("{}: the series has no coordinate {}", data.name,
                                                problem.coordinate(errors[c].coordinate).name));
        record.values.row(static_cast<Index>(c)) = from.values.row(*row);
        if (!errors[c].sd_column.empty() && from.deviations.size() > 0)
            record.deviations.row(static_cast<Index>(c)) = from.deviations.row(*row);
    }
}

periodic::WaveformOptions waveform_options(const WaveformChoice& asked, const Eigen::VectorXd& start) {
    periodic::WaveformOptions options;
    std::vector<Index> coordinates;
    for (const RecordErrors& error : asked.errors) {
        options.channels.push_back({error.coordinate, error.scale, error.distribution, error.floor,
                                    asked.of_cycles || !error.sd_column.empty()});
        coordinates.push_back(error.coordinate);
    }
    options.covariances = joint_covariances(asked.covariances, coordinates);
    options.start = start;
    return options;
}

/// The period of the record of an experiment.
/// @throws orbits::DataError when it has none.
orbits::RecordPeriod told_period(const IdentificationProblem& problem, const Experiment& data) {
    const orbits::Series& series = *data.series;
    std::vector<Index> rows;
    for (const Index coordinate : data.observe)
        if (const auto row = series_row(problem, series, coordinate)) rows.push_back(*row);
    orbits::RecordPeriod period;
    try {
        period = orbits::record_period(series, rows, data.fitted_segments());
    } catch (const orbits::DataError& error) {
        throw orbits::DataError(fmt::format("{}: its period cannot be told: {}", data.name, error.what()));
    }
    if (period.periodic) return period;
    throw orbits::DataError(
        fmt::format("{}: the record does not repeat: it {}; give \"time\", a guess of its period in s, or use a "
                    "residual of type series",
                    data.name, orbits::description(period, series)));
}

/// The distance, in ranges, of states from those a time later: the root mean square of some of them, evenly spread.
/// Nothing where none is followed so far.
std::optional<double> distance_after(const models::System& system, const Eigen::VectorXd& theta,
                                     const FollowedStates& known, double time) {
    constexpr Index compared = 64;
    constexpr models::FlowOptions coarse{1e-8, 1e-8, 100000};
    const Index count = known.times.size();
    const Eigen::VectorXd range =
        (known.states.rowwise().maxCoeff() - known.states.rowwise().minCoeff()).cwiseMax(1e-300);
    double sum = 0.0, number = 0.0;
    for (Index k = 0; k < count; k += std::max<Index>(1, count / compared)) {
        // Between two states that were followed, the flow from the earlier one.
        const double* first = known.times.data();
        const Index after = std::upper_bound(first, first + count, known.times[k] + time) - first;
        if (after >= count) break;
        const std::array<double, 1> rest{known.times[k] + time - known.times[after - 1]};
        const auto flow = system.flow(known.states.col(after - 1), 0.0, rest, theta, models::Clock::time, coarse);
        if (flow.status != models::FlowStatus::ok) continue;
        Eigen::VectorXd change = flow.states.col(0) - known.states.col(k);
        for (Index i = 0; i < change.size(); ++i)
            if (system.coordinates()[static_cast<std::size_t>(i)].angle) change[i] = models::wrapped(change[i]);
        sum += change.cwiseQuotient(range).squaredNorm();
        number += 1.0;
    }
    if (number == 0.0) return std::nullopt;
    return std::sqrt(sum / number);
}

/// A state of the orbit and its period: the multiple of the readings' period after which the states come back.
std::optional<periodic::StartingSolution> start_among(const models::System& system, const Eigen::VectorXd& theta,
                                                      const FollowedStates& known, double time) {
    constexpr int most_multiples = 8;
    // An orbit that has closed is far nearer than at any other multiple: by this factor, or in ranges.
    constexpr double nearer = 4.0, near = 0.02;
    std::vector<double> distances;
    for (int multiple = 1; multiple <= most_multiples; ++multiple)
        if (const auto distance = distance_after(system, theta, known, multiple * time))
            distances.push_back(*distance);
        else
            break;
    if (distances.empty()) return std::nullopt;
    const double least = *std::min_element(distances.begin(), distances.end());
    const auto first = std::find_if(distances.begin(), distances.end(),
                                    [&](double distance) { return distance <= std::max(nearer * least, near); });
    periodic::StartingSolution start;
    start.points = known.states.col(known.times.size() / 2);
    start.time = time * static_cast<double>(first - distances.begin() + 1);
    return start;
}

/// The record of one segment.
periodic::WaveformRecord waveform_record(const IdentificationProblem& problem, const orbits::Series& series,
                                         const EstimateSetup& setup, const WaveformChoice::Experiment& own,
                                         ProblemWaveform::Place place) {
    const Experiment& data = problem.experiments[place.experiment];
    periodic::WaveformRecord record;
    record.label = block_label(problem, series, place.experiment, place.segment);
    record.binding = setup.experiments[place.experiment];
    record.sensor = data.sensor;
    take_readings(problem, data, series, place.segment, record);
    record.period = own.period;
    record.time = own.time;
    record.phase = own.phase;
    record.offsets = own.offsets;
    if (own.start.size() > 0) {
        record.start.emplace();
        record.start->points = own.start;
        record.start->time = own.time;
    }
    return record;
}

/// A record per cycle that the model has an orbit for. @return a line per cycle without one
std::vector<std::string> add_cycles(const IdentificationProblem& problem, const EstimateSetup& setup,
                                    const Eigen::VectorXd& start, ProblemWaveform& waveform,
                                    std::vector<periodic::WaveformRecord>& records) {
    const WaveformChoice& asked = *problem.waveform;
    const std::size_t experiment = asked.data.front();
    const Experiment& data = problem.experiments[experiment];
    std::vector<Index> coordinates;
    for (const RecordErrors& error : asked.errors)
        coordinates.push_back(error.coordinate);
    if (asked.cycles.empty())
        throw orbits::DataError(fmt::format("{}: there is no cycle to compare the model with", data.name));
    const auto pairs = paired_orbits(*problem.system, setup.experiments[experiment].values(start), asked.cycles,
                                     coordinates, data.sensor);
    std::vector<std::string> said;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
        const orbits::CycleWaveform& cycle = asked.cycles[i];
        const std::string label = fmt::format("cycle {} (period {})", cycle.cycle, cycle.period);
        if (!pairs[i]) {
            said.push_back(
                fmt::format("{}: {} is not used: the model has no orbit like it at the start", data.name, label));
            continue;
        }
        periodic::WaveformRecord record;
        record.label = label;
        record.binding = setup.experiments[experiment];
        record.sensor = data.sensor;
        record.times = cycle.times;
        record.values = cycle.values;
        record.deviations = cycle.deviations;
        record.time = pairs[i]->time;
        record.start = pairs[i]->start;
        records.push_back(std::move(record));
        waveform.places.push_back({experiment, 0});
    }
    if (records.empty())
        throw orbits::DataError(fmt::format(
            "{}: the model has no orbit like any of the {} cycles at the start: start the parameters nearer, "
            "or search for cycles of other periods",
            data.name, asked.cycles.size()));
    return said;
}

}  // namespace

std::vector<std::string> add_waveform(const IdentificationProblem& problem, const EstimateSetup& setup,
                                      const Eigen::VectorXd& start, ProblemWaveform& waveform,
                                      std::span<const FollowedStates> followed) {
    if (!problem.waveform) return {};
    const WaveformChoice& asked = *problem.waveform;
    waveform.places.clear();
    std::vector<periodic::WaveformRecord> records;
    std::vector<std::string> said;
    if (asked.of_cycles) said = add_cycles(problem, setup, start, waveform, records);
    for (std::size_t i = 0; i < asked.data.size() && !asked.of_cycles; ++i) {
        const std::size_t experiment = asked.data[i];
        const Experiment& data = problem.experiments[experiment];
        WaveformChoice::Experiment own = asked.experiments[i];
        const bool told = problem.system->kind() == models::Kind::autonomous && own.time == 0.0;
        if (told) {
            const orbits::RecordPeriod period = told_period(problem, data);
            own.time = period.time;
            said.push_back(fmt::format("{}: {}", data.name, orbits::description(period, *data.series)));
        }
        for (const std::size_t segment : data.fitted_segments()) {
            waveform.places.push_back({experiment, segment});
            records.push_back(waveform_record(problem, *data.series, setup, own, waveform.places.back()));
            if (!told || records.back().start) continue;
            const auto known = std::find_if(followed.begin(), followed.end(), [&](const FollowedStates& one) {
                return one.experiment == experiment && one.segment == segment;
            });
            if (known == followed.end()) continue;
            records.back().start =
                start_among(*problem.system, setup.experiments[experiment].values(start), *known, own.time);
            if (records.back().start) records.back().time = records.back().start->time;
        }
    }
    waveform.residual = std::make_unique<periodic::WaveformResidual>(problem.system, std::move(records),
                                                                     waveform_options(asked, start));
    std::vector<std::string> lost;
    for (std::size_t b = 0; b < waveform.places.size(); ++b) {
        const periodic::OrbitStatus status = waveform.residual->start_status(b);
        if (status == periodic::OrbitStatus::converged) continue;
        lost.push_back(fmt::format("{}: no periodic solution at the start: {}", waveform.residual->records()[b].label,
                                   periodic::name(status)));
    }
    if (lost.size() == waveform.places.size())
        throw orbits::DataError(
            fmt::format("{}; start the parameters nearer, or give \"start\": states at phase 0 near the orbit",
                        fmt::join(lost, "; ")));
    said.insert(said.end(), lost.begin(), lost.end());
    return said;
}

}  // namespace orbid::identification

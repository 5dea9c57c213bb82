#include "identification/problem/problem_waveform.hpp"

#include <algorithm>
#include <stdexcept>

#include <fmt/format.h>

#include "estimator/interface/not_finite.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::identification {

namespace {

using Eigen::Index;

std::string block_label(const IdentificationProblem& problem, const orbits::Series& series, std::size_t experiment,
                        std::size_t segment) {
    const std::string& name = problem.experiments[experiment].name;
    return series.segments.size() > 1 ? fmt::format("{}, segment {}", name, series.segments[segment].label) : name;
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
        const auto name = problem.coordinate(errors[c].coordinate).name;
        const auto at = std::find_if(series.coordinates.begin(), series.coordinates.end(),
                                     [&](const orbits::SeriesCoordinate& one) { return one.name == name; });
        if (at == series.coordinates.end())
            throw orbits::DataError(fmt::format("{}: the series has no coordinate {}", data.name, name));
        const auto row = at - series.coordinates.begin();
        record.values.row(static_cast<Index>(c)) = from.values.row(row);
        if (!errors[c].sd_column.empty() && from.deviations.size() > 0)
            record.deviations.row(static_cast<Index>(c)) = from.deviations.row(row);
    }
}

periodic::WaveformOptions waveform_options(const WaveformChoice& asked, const Eigen::VectorXd& start) {
    periodic::WaveformOptions options;
    std::vector<Index> coordinates;
    for (const RecordErrors& error : asked.errors) {
        options.channels.push_back(
            {error.coordinate, error.scale, error.distribution, error.floor, !error.sd_column.empty()});
        coordinates.push_back(error.coordinate);
    }
    options.covariances = joint_covariances(asked.covariances, coordinates);
    options.start = start;
    return options;
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

}  // namespace

std::vector<std::string> add_waveform(const IdentificationProblem& problem, const EstimateSetup& setup,
                                      const Eigen::VectorXd& start, ProblemWaveform& waveform) {
    if (!problem.waveform) return {};
    const WaveformChoice& asked = *problem.waveform;
    waveform.places.clear();
    std::vector<periodic::WaveformRecord> records;
    for (std::size_t i = 0; i < asked.data.size(); ++i) {
        const std::size_t experiment = asked.data[i];
        const orbits::Series& series = *problem.experiments[experiment].series;
        for (const std::size_t segment : problem.experiments[experiment].fitted_segments()) {
            waveform.places.push_back({experiment, segment});
            records.push_back(waveform_record(problem, series, setup, asked.experiments[i], waveform.places.back()));
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
    return lost;
}

}  // namespace orbid::identification

#include <algorithm>

#include "apps/job/job_parts.hpp"

namespace orbid::apps {

namespace {

using Sampling = orbits::Series::Sampling;

void read_cycles(ObjectReader& object, const Job& job, EstimateJob& estimate) {
    CyclesResidualJob cycles;
    const bool searched = job.orbits && !job.orbits->file;
    if (!job.orbits) object.self().report("needs \"orbits\": { ... }, a search for cycles or a file of them");
    if (job.model.system && job.model.system->kind() == models::Kind::autonomous)
        object.self().report(
            fmt::format("cycles of the model {}, which is autonomous: {}", job.model.name, not_in_this_version));
    if (searched) cycles.periods = job.orbits->search.periods;
    if (const auto periods = object.find("periods")) {
        cycles.periods = read_periods(*periods).value_or(cycles.periods);
        for (const int period : cycles.periods) {
            const auto& found = job.orbits ? job.orbits->search.periods : cycles.periods;
            if (searched && std::find(found.begin(), found.end(), period) == found.end())
                periods->report(
                    fmt::format("period {} is not searched for: it does not stand in /orbits/periods", period));
        }
    }
    if (const auto weights = object.find("weights")) cycles.covariance = weights->choice({"covariance", "equal"}) != 1;
    const auto positions = object.find("positions");
    if (positions) cycles.positions = positions->boolean().value_or(true);
    if (const auto multipliers = object.find("multipliers"))
        cycles.multipliers = multipliers->boolean().value_or(false);
    if (!cycles.positions && !cycles.multipliers)
        positions->report("must be true without \"multipliers\": true: nothing is left to compare");
    ErrorUse use;
    if (cycles.multipliers) use.multipliers = &cycles.multiplier_error;
    use.records = cycles.covariance ? ErrorUse::Records::cycles_with_covariance : ErrorUse::Records::cycles;
    for (std::size_t i = 0; i < coordinate_names(job).size(); ++i)
        use.coordinates.push_back(static_cast<Eigen::Index>(i));
    read_errors(object, use, job, cycles.errors, cycles.covariances);
    if (estimate.cycles) object.self().report(fmt::format("a second residual of type cycles: {}", not_in_this_version));
    estimate.cycles = std::move(cycles);
}

void read_series_data(const ValueReader& value, const Job& job, SeriesResidualJob& series) {
    std::vector<std::string> known;
    for (const DataJob& data : job.data)
        known.push_back(data.name);
    for (const auto& [name, item] : read_names(value)) {
        const auto at = std::find(known.begin(), known.end(), name);
        if (at == known.end()) {
            item.report(fmt::format("there are no data named \"{}\"{}", name, suggestion(name, known)));
            continue;
        }
        series.data.push_back(static_cast<std::size_t>(at - known.begin()));
    }
    std::sort(series.data.begin(), series.data.end());
}

/// Errors that link readings of different intervals, or of several coordinates, are those of whole segments.
void check_short_intervals(const ValueReader& at, const SeriesResidualJob& series) {
    const bool lasting = std::any_of(series.errors.begin(), series.errors.end(), [](const ErrorJob& error) {
        return std::holds_alternative<estimator::AutoregressiveErrors>(error.distribution);
    });
    if (lasting) at.report("errors \"ar1\" last over many intervals: use \"interval\": \"segment\"");
    if (!series.covariances.empty())
        at.report(fmt::format("a full covariance with nodes within a segment: {}; use \"interval\": \"segment\"",
                              not_in_this_version));
}

void read_series(ObjectReader& object, const Job& job, EstimateJob& estimate) {
    SeriesResidualJob series;
    if (const auto data = object.find("data")) {
        read_series_data(*data, job, series);
    } else {
        // Samples where there are some: sections beside them are usually there to be searched for cycles.
        for (const Sampling sampling : {Sampling::samples, Sampling::section}) {
            if (!series.data.empty()) break;
            for (std::size_t i = 0; i < job.data.size(); ++i)
                if (job.data[i].sampling() == sampling) series.data.push_back(i);
        }
        if (series.data.empty()) object.self().report("needs an entry of \"data\"");
    }
    read_shooting(object, job, estimate.automatic, series);
    ErrorUse use;
    use.records = ErrorUse::Records::series;
    use.data = series.data;
    for (const std::size_t index : series.data) {
        const models::Sensor& sensor = job.data[index].sensor;
        for (const Eigen::Index coordinate : job.data[index].observe) {
            // A rate that is a difference of two readings of an angle has their errors, none of its own. (Over a whole
            // segment it is compared as a reading.)
            const bool is_second_reading = series.interval && coordinate == static_cast<Eigen::Index>(sensor.rate) &&
                                           sensor.type == models::Sensor::Type::angle_difference;
            if (!is_second_reading) use.coordinates.push_back(coordinate);
        }
    }
    std::sort(use.coordinates.begin(), use.coordinates.end());
    use.coordinates.erase(std::unique(use.coordinates.begin(), use.coordinates.end()), use.coordinates.end());
    read_errors(object, use, job, series.errors, series.covariances);
    if (series.interval) check_short_intervals(object.self(), series);
    if (estimate.series) object.self().report(fmt::format("a second residual of type series: {}", not_in_this_version));
    estimate.series = std::move(series);
}

}  // namespace

void read_residuals(const ValueReader& value, const Job& job, EstimateJob& estimate) {
    for (const ValueReader& item : value.items()) {
        ObjectReader object(item);
        const auto type = object.find("type");
        const auto choice = type ? type->choice({"cycles", "series", "waveform"}) : std::nullopt;
        if (!choice) continue;  // without the type every other key would be called unknown
        if (*choice == 0) {
            read_cycles(object, job, estimate);
        } else if (*choice == 1) {
            read_series(object, job, estimate);
        } else {
            read_waveform(object, job, estimate);
        }
        object.finish();
    }
}

}  // namespace orbid::apps

#include <algorithm>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/job_parts.hpp"
#include "apps/job/orbits_job.hpp"

namespace orbid::apps {

namespace {

using Sampling = orbits::Series::Sampling;

/// "exact", "auto", { "sd": "estimate" } or { "sd": share of the range }.
MatchingJob read_matching(const ValueReader& value) {
    MatchingJob matching;
    if (value.is(JsonValue::Kind::string)) {
        if (value.choice({"exact", "auto"}) == 0) matching.kind = MatchingJob::Kind::exact;
        return matching;
    }
    if (value.refused()) return matching;
    ObjectReader object(value);
    if (const auto sd = object.find("sd")) {
        if (sd->is(JsonValue::Kind::string)) {
            (void)sd->choice({"estimate"});
            matching.kind = MatchingJob::Kind::estimated;
        } else {
            matching.kind = MatchingJob::Kind::given;
            sd->read(matching.sd);
        }
    }
    object.finish();
    return matching;
}

/// Something is said of where segments begin.
bool says_more(const InitialValueJob& initial) {
    return !initial.estimate || initial.value || initial.is_parameter() ||
           !std::holds_alternative<estimator::FlatPrior>(initial.prior);
}

/// What single shooting alone can have.
void check_nodes(const ValueReader& at, const Job& job, const SeriesResidualJob& series) {
    for (const std::size_t index : series.data) {
        const DataJob& data = job.data[index];
        if (data.sensor.type == models::Sensor::Type::function)
            at.report(fmt::format("\"{}\" is read by formulas: use \"interval\": \"segment\"", data.name));
        if (std::any_of(data.initial_state.begin(), data.initial_state.end(), says_more))
            at.report(
                fmt::format("\"initial_state\" of \"{}\" goes with \"interval\": \"segment\": every node is a "
                            "free state",
                            data.name));
    }
}

/// "matching" and "interval", after the data. `staged`: the strategy chooses what is not given.
void read_shooting(ObjectReader& object, const Job& job, bool staged, SeriesResidualJob& series) {
    const bool sections = std::any_of(series.data.begin(), series.data.end(), [&](std::size_t index) {
        return job.data[index].sampling() == Sampling::section;
    });
    const auto matching = object.find("matching");
    if (matching) series.matching = read_matching(*matching);
    const bool has_sd =
        series.matching.kind == MatchingJob::Kind::given || series.matching.kind == MatchingJob::Kind::estimated;
    const auto interval = object.find("interval");
    // Samples over short segments need one free state each; whatever says that there is more to it asks for nodes.
    bool whole_segments = !sections && !has_sd && !staged;
    if (interval && interval->is(JsonValue::Kind::string)) {
        whole_segments = interval->choice({"auto", "segment"}) == 1;
        if (whole_segments && sections)
            interval->report("holds for samples: a section series is followed from section to section, \"auto\" or 1");
        if (whole_segments && has_sd)
            matching->report("nothing is matched where the flow runs over whole segments: use \"interval\": \"auto\"");
    } else if (interval && interval->is(JsonValue::Kind::number)) {
        whole_segments = false;
        series.interval = interval->whole().value_or(1);
    }
    if (whole_segments) {
        series.matching.kind = MatchingJob::Kind::exact;
        return;
    }
    if (!series.interval) series.interval = SeriesResidualJob::automatic_interval;
    check_nodes(interval.value_or(object.self()), job, series);
}

void read_cycles(ObjectReader& object, const Job& job, EstimateJob& estimate) {
    CyclesResidualJob cycles;
    const bool searched = job.orbits && !job.orbits->file;
    if (!job.orbits) object.self().report("needs \"orbits\": { ... }, a search for cycles or a file of them");
    if (job.model.is(models::Kind::autonomous))
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
    const auto positions = object.read("positions", cycles.positions);
    object.read("multipliers", cycles.multipliers);
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
        series.data = read_experiments(*data, job);
    } else {
        // Samples where there are some: sections beside them are usually there to be searched for cycles.
        series.data = experiments_with(job, Sampling::samples);
        if (series.data.empty()) series.data = experiments_with(job, Sampling::section);
        if (series.data.empty()) object.self().report("needs an entry of \"data\"");
    }
    read_shooting(object, job, estimate.automatic, series);
    ErrorUse use;
    use.records = ErrorUse::Records::series;
    use.data = series.data;
    for (const std::size_t index : series.data) {
        const models::Sensor& sensor = job.data[index].sensor;
        std::vector<Eigen::Index> coordinates = job.data[index].observe;
        // A rate that is a difference of two readings of an angle has their errors, none of its own. (Over a whole
        // segment it is compared as a reading.)
        if (series.interval && sensor.type == models::Sensor::Type::angle_difference)
            std::erase(coordinates, static_cast<Eigen::Index>(sensor.rate));
        use.add_coordinates(coordinates);
    }
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
        const auto choice = type ? type->choice(residual_type_names) : std::nullopt;
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

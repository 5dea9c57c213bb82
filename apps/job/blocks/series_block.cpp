#include <algorithm>

#include "apps/job/blocks/estimate_fields.hpp"
#include "apps/job/data_job.hpp"

namespace orbid::apps::describe {

namespace {

using Json = nlohmann::ordered_json;
using Sampling = orbits::Series::Sampling;

// Longer than any record; keeps a slip of the pen from overflowing.
constexpr double longest_interval = 1e9;

/// "exact", "auto", { "sd": "estimate" } or { "sd": share of the range }.
void read_matching(const ValueReader& value, const Job&, SeriesResidualJob& series) {
    MatchingJob& matching = series.matching;
    if (value.is(JsonValue::Kind::string)) {
        if (value.choice({"exact", "auto"}) == 0) matching.kind = MatchingJob::Kind::exact;
        return;
    }
    if (value.refused()) return;
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
}

Json matching_document(const SeriesResidualJob& series, const Writing&) {
    switch (series.matching.kind) {
        case MatchingJob::Kind::exact:
            return "exact";
        case MatchingJob::Kind::given:
            return {{"sd", series.matching.sd}};
        case MatchingJob::Kind::estimated:
            return {{"sd", "estimate"}};
        case MatchingJob::Kind::automatic:
        case MatchingJob::Kind::diffusion:
            break;
    }
    return "auto";
}

/// { "noise": "none" } or { "noise": "estimate" }.
void read_dynamics(const ValueReader& value, const Job&, SeriesResidualJob& series) {
    ObjectReader object(value);
    const auto noise = object.find("noise");
    const bool estimated = noise && noise->choice({"none", "estimate"}) == 1;
    object.finish();
    if (!estimated) return;
    if (series.matching.kind != MatchingJob::Kind::automatic)
        value.report("process noise is the error of nodes that do not meet: leave out \"matching\", or say \"auto\"");
    series.matching.kind = MatchingJob::Kind::diffusion;
}

Json dynamics_document(const SeriesResidualJob&, const Writing&) {
    return {{"noise", "estimate"}};
}

void read_interval(const ValueReader& value, const Job&, SeriesResidualJob& series) {
    if (value.is(JsonValue::Kind::number)) {
        series.interval = value.whole().value_or(1);
    } else if (value.is(JsonValue::Kind::string) && value.choice({"auto", "segment"}) != 1) {
        series.interval = SeriesResidualJob::automatic_interval;
    }
}

Json interval_document(const SeriesResidualJob& series, const Writing&) {
    if (!series.interval) return series.unless_errors_grow ? left_out() : Json("segment");
    return *series.interval == SeriesResidualJob::automatic_interval ? Json("auto") : Json(*series.interval);
}

/// Something is said of where segments begin.
bool says_more(const InitialValueJob& initial) {
    return !initial.estimate || initial.value || initial.is_parameter() ||
           !std::holds_alternative<estimator::FlatPrior>(initial.prior);
}

/// A free state from which nodes can be followed: a start and nothing else.
bool is_plain_start(const InitialValueJob& initial) {
    return initial.estimate && !initial.is_parameter() && std::holds_alternative<estimator::FlatPrior>(initial.prior);
}

/// Whether nothing is said of where the segments of an experiment begin but where a search may begin.
bool has_free_nodes(const DataJob& data) {
    const auto& initial = data.initial_state;
    if (data.sensor.type == models::Sensor::Type::function)
        return std::all_of(initial.begin(), initial.end(), is_plain_start);
    return std::none_of(initial.begin(), initial.end(), says_more);
}

/// What single shooting alone can have.
void check_nodes(const ValueReader& at, const Job& job, const SeriesResidualJob& series) {
    for (const std::size_t index : series.data) {
        const DataJob& data = job.data[index];
        if (has_free_nodes(data)) continue;
        at.report(fmt::format(
            "\"initial_state\" of \"{}\" goes with \"interval\": \"segment\": every node is a "
            "free state{}",
            data.name,
            data.sensor.type == models::Sensor::Type::function ? ", and only \"start\" helps to find the first" : ""));
    }
}

/// Process noise acts from node to node, over times that are short.
void check_noise(ObjectReader& object, bool sections, const SeriesResidualJob& series) {
    if (series.matching.kind != MatchingJob::Kind::diffusion) return;
    const auto dynamics = object.find("dynamics");
    if (sections)
        dynamics->report("process noise needs samples in time: between sections it depends on all of the course");
    else if (const auto interval = object.find("interval"); interval && !interval->refused() && !series.interval)
        dynamics->report(
            "process noise acts from node to node, and whole segments have no nodes: use \"interval\": \"auto\" or a "
            "number of samples");
}

/// Chooses nodes or whole segments. `staged`: the strategy chooses what is not given.
void complete_shooting(ObjectReader& object, const Job& job, bool staged, SeriesResidualJob& series) {
    const bool sections = std::any_of(series.data.begin(), series.data.end(), [&](std::size_t index) {
        return job.data[index].sampling() == Sampling::section;
    });
    const bool has_sd =
        series.matching.kind == MatchingJob::Kind::given || series.matching.kind == MatchingJob::Kind::estimated;
    const bool noisy = series.matching.kind == MatchingJob::Kind::diffusion;
    check_noise(object, sections, series);
    auto interval = object.find("interval");
    if (interval && interval->refused()) interval.reset();
    // Samples over short segments need one free state each; whatever says that there is more to it asks for nodes.
    const bool whole_segments = interval ? !series.interval : !sections && !has_sd && !noisy && !staged;
    if (interval && whole_segments && sections)
        interval->report("holds for samples: a section series is followed from section to section, \"auto\" or 1");
    if (interval && whole_segments && has_sd)
        object.find("matching")
            ->report("nothing is matched where the flow runs over whole segments: use \"interval\": \"auto\"");
    if (whole_segments) {
        series.unless_errors_grow = !interval;
        return;
    }
    if (!series.interval) series.interval = SeriesResidualJob::automatic_interval;
    check_nodes(interval.value_or(object.self()), job, series);
}

/// Errors that last over many intervals.
bool has_lasting_errors(const SeriesResidualJob& series) {
    return std::any_of(series.errors.begin(), series.errors.end(), [](const ErrorJob& error) {
        return std::holds_alternative<estimator::AutoregressiveErrors>(error.distribution);
    });
}

/// Errors that link readings of different intervals, or of several coordinates, are those of whole segments.
void check_short_intervals(const ValueReader& at, const SeriesResidualJob& series) {
    if (has_lasting_errors(series)) at.report("errors \"ar1\" last over many intervals: use \"interval\": \"segment\"");
    if (!series.covariances.empty())
        at.report(fmt::format("a full covariance with nodes within a segment: {}; use \"interval\": \"segment\"",
                              not_in_this_version));
}

/// States are integrated out as normal ones.
void check_normal_errors(ObjectReader& object, const SeriesResidualJob& series) {
    if (series.matching.kind != MatchingJob::Kind::diffusion) return;
    for (const ErrorJob& error : series.errors)
        if (!std::holds_alternative<estimator::NormalErrors>(error.distribution)) {
            object.find("dynamics")->report("process noise goes with normal errors of the readings");
            return;
        }
}

/// Whether a series over whole segments could have nodes as it is.
bool can_have_nodes(const Job& job, const SeriesResidualJob& series) {
    return !has_lasting_errors(series) && series.covariances.empty() &&
           std::all_of(series.data.begin(), series.data.end(), [&](std::size_t index) {
               return has_free_nodes(job.data[index]) &&
                      job.data[index].sensor.type != models::Sensor::Type::angle_difference;
           });
}

}  // namespace

const FieldTable<SeriesResidualJob>& series_fields() {
    using Series = SeriesResidualJob;
    static const FieldTable<Series> table = [] {
        const ValueSchema matching =
            choice({"exact", "auto"}) |
            object({key("sd", choice({"estimate"}) | above_up_to(0.0, 1.0), "As a share of each coordinate's range.")
                        .required_always()});
        FieldTable<Series> fields{
            experiments_field<Series>(),
            Field<Series>{key("interval", choice({"auto", "segment"}) | whole(1, longest_interval),
                              "Samples or sections from node to node; \"segment\": one initial state per segment, the "
                              "default for samples unless errors grow along them."),
                          read_interval, interval_document}
                .written_after("matching"),
            {key("matching", matching, "How well the end of one interval meets the beginning of the next.")
                 .by_default("auto"),
             read_matching, matching_document},
            Field<Series>{
                key("dynamics",
                    object({key("noise", choice({"none", "estimate"}),
                                "\"estimate\": the model is disturbed by white noise, whose strength is estimated.")
                                .required_always()}),
                    "Errors of the model itself: a diffusion of every coordinate whose equation is not x' = v."),
                read_dynamics, dynamics_document}
                .written_if([](const Series& series) { return series.matching.kind == MatchingJob::Kind::diffusion; })};
        add_error_fields(fields);
        return fields;
    }();
    return table;
}

void prepare_series(ObjectReader& object, const Job& job, SeriesResidualJob& series) {
    if (object.find("data")) return;
    // Samples where there are some: sections beside them are usually there to be searched for cycles.
    series.data = experiments_with(job, Sampling::samples);
    if (series.data.empty()) series.data = experiments_with(job, Sampling::section);
    std::erase_if(series.data, [&](std::size_t index) { return job.data[index].streamed(); });
    if (series.data.empty()) object.self().report("needs an entry of \"data\", no stream");
}

void complete_series(ObjectReader& object, const Job& job, bool staged, SeriesResidualJob& series) {
    complete_shooting(object, job, staged, series);
    ErrorUse use;
    use.records = ErrorUse::Records::series;
    use.data = series.data;
    for (const std::size_t index : series.data) {
        if (job.data[index].streamed())
            object.self().report(fmt::format("uses the record \"{}\" as a whole, but that is a stream (\"stream\")",
                                             job.data[index].name));
        const models::Sensor& sensor = job.data[index].sensor;
        std::vector<Eigen::Index> coordinates = job.data[index].observe;
        // A rate that is a difference of two readings of an angle has their errors, none of its own. (Over a whole
        // segment it is compared as a reading.)
        if (series.interval && sensor.type == models::Sensor::Type::angle_difference)
            std::erase(coordinates, static_cast<Eigen::Index>(sensor.rate));
        use.add_coordinates(coordinates);
    }
    read_errors(object, use, job, series.errors, series.covariances);
    if (series.interval) {
        check_short_intervals(object.self(), series);
        check_normal_errors(object, series);
        return;
    }
    series.unless_errors_grow = series.unless_errors_grow && can_have_nodes(job, series);
    if (!series.unless_errors_grow) series.matching.kind = MatchingJob::Kind::exact;
}

}  // namespace orbid::apps::describe

#include <algorithm>

#include "apps/job/job_parts.hpp"

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
            matching.sd = sd->number().value_or(1.0);
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
        if (data.inputs) at.report(fmt::format("\"{}\" has measured inputs: use \"interval\": \"segment\"", data.name));
        if (data.sensor.type == models::Sensor::Type::function)
            at.report(fmt::format("\"{}\" is read by formulas: use \"interval\": \"segment\"", data.name));
        if (std::any_of(data.initial_state.begin(), data.initial_state.end(), says_more))
            at.report(
                fmt::format("\"initial_state\" of \"{}\" goes with \"interval\": \"segment\": every node is a "
                            "free state",
                            data.name));
    }
}

}  // namespace

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

}  // namespace orbid::apps

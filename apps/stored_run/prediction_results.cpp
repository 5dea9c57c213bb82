#include "apps/stored_run/prediction_results.hpp"

#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "apps/documents/json_text.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;

/// A change of the initial state that grows by less than a thousand (e^7) over the record is no chaos worth a Lyapunov
/// time: transients and drifts of a phase do as much.
constexpr double chaotic_growth = 7.0;

Json rms_json(const std::vector<CoordinateForecast>& list) {
    Json out = Json::object();
    for (const CoordinateForecast& one : list)
        out[one.name] = {{"rms", one.rms}, {"sd", one.sd}, {"unit", one.unit}};
    return out;
}

Json segment_json(const SegmentForecast& one) {
    Json out;
    out["segment"] = one.segment;
    out["message"] = json_or_null(one.message);
    out["readings"] = one.readings;
    out["duration"] = one.duration;
    Json course = Json::object();
    for (const CoordinateForecast& coordinate : one.course)
        course[coordinate.name] = coordinate.rms;
    out["course"] = {{"rms", course}, {"normalised_rms", one.course_normalised}};
    out["ahead"] = {{"beginning", one.beginning},
                    {"coordinates", rms_json(one.ahead)},
                    {"normalised_rms", one.ahead_normalised},
                    {"horizon", one.horizon},
                    {"whole", one.whole},
                    {"growth_rate", one.growth},
                    {"coverage95", one.coverage},
                    {"covered", one.covered}};
    return out;
}

std::string rms_words(const std::vector<CoordinateForecast>& list) {
    std::string words;
    // Coordinates without a reading have no rms.
    for (const CoordinateForecast& one : list)
        if (std::isfinite(one.rms))
            words += fmt::format("{}{} {}{}", words.empty() ? "" : ", ", one.name, significant(one.rms, 4),
                                 one.unit.empty() || one.unit == "1" ? "" : " " + one.unit);
    return words;
}

std::string sections_table(const StepForecast& steps) {
    SummaryTable table({left_aligned("coordinate"), "rms of errors", "sd of readings", "rms that they explain", "ratio",
                        left_aligned("unit")});
    for (std::size_t c = 0; c < steps.coordinates.size(); ++c) {
        const CoordinateForecast& one = steps.coordinates[c];
        table.add({one.name, significant(one.rms, 4), significant(one.sd, 3), significant(steps.expected[c], 4),
                   significant(one.rms / steps.expected[c], 3), one.unit == "1" ? "" : one.unit});
    }
    return table.text();
}

bool is_chaotic(const SegmentForecast& one) {
    return one.growth * (one.duration - one.beginning) > chaotic_growth;
}

std::string horizon_words(const SegmentForecast& one) {
    if (!std::isfinite(one.horizon)) return "";
    std::string words = one.whole ? fmt::format("all {}", significant(one.horizon, 3)) : significant(one.horizon, 3);
    if (is_chaotic(one)) words += fmt::format(" ({} Lyapunov times)", significant(one.horizon * one.growth, 2));
    return words;
}

std::string samples_tables(const Forecast& forecast) {
    SummaryTable course({left_aligned("segment"), "readings", left_aligned("rms of errors"), "rms / error sd"});
    SummaryTable ahead({left_aligned("segment"), "fitted to", "of", left_aligned("rms of errors"), "rms / error sd",
                        left_aligned("within 2 sds for"), left_aligned("in the 95 % band")});
    std::string failures;
    for (const SegmentForecast& one : forecast.segments) {
        // Without a known sd of the readings there still is an rms.
        if (const std::string rms = rms_words(one.course); !rms.empty())
            course.add({one.segment, std::to_string(one.readings), rms, significant(one.course_normalised, 3)});
        if (!one.message.empty()) {
            failures += fmt::format("  segment {}: {}\n", one.segment, one.message);
            continue;
        }
        const std::string coverage = std::isfinite(one.coverage)
                                         ? fmt::format("{:.1f} % of {} readings", 100.0 * one.coverage, one.covered)
                                         : std::string();
        ahead.add({one.segment, significant(one.beginning, 3), significant(one.duration, 3), rms_words(one.ahead),
                   significant(one.ahead_normalised, 3), horizon_words(one), coverage});
    }
    return titled("Course: the initial state fitted to the whole segment", course.text()) +
           titled("Ahead: the initial state fitted to the beginning alone", ahead.text()) +
           titled("Not predicted", failures);
}

/// The larger share of segments decides what is said of all.
std::string samples_remarks(const Forecast& forecast) {
    std::string out;
    double squares = 0.0;
    std::size_t count = 0;
    bool chaotic = false;
    bool early = true;  // every forecast of a chaotic segment ends within a Lyapunov time
    for (const SegmentForecast& one : forecast.segments) {
        chaotic = chaotic || is_chaotic(one);
        if (is_chaotic(one) && !(one.horizon * one.growth < 1.0)) early = false;
        if (!std::isfinite(one.course_normalised)) continue;
        squares += one.course_normalised * one.course_normalised;
        ++count;
    }
    if (chaotic) {
        out +=
            "  the record is chaotic: what is not known of its beginning grows until nothing is left of a forecast, "
            "also of a\n  true model; the horizon says how far that is, and \"course\" may fail for this reason "
            "alone\n";
        if (early)
            out +=
                "  but it ends within one Lyapunov time, before the beginning can be blamed: the model, its parameters "
                "or the error\n  scale do not describe this record\n";
    } else if (count > 0) {
        const std::string said = judgement(std::sqrt(squares / static_cast<double>(count)));
        if (!said.empty()) out += "  " + said + "\n";
    }
    if (!forecast.known_errors)
        out += "  the run has no sd of these readings: that of the fits to the beginnings stands for it\n";
    return out;
}

}  // namespace

std::string judgement(double normalised_rms) {
    // Half as much again, or two thirds: beyond what the uncertainty of an error scale usually is.
    constexpr double large = 1.5;
    if (normalised_rms > large)
        return fmt::format(
            "errors of the prediction are {} times those of the readings: the model, its parameters or the error scale "
            "do not describe this record",
            significant(normalised_rms, 3));
    if (normalised_rms < 1.0 / large)
        return fmt::format(
            "errors of the prediction are only {} times what the error scale says: the scale is too large for this "
            "record",
            significant(normalised_rms, 3));
    return {};
}

std::string prediction_text(const Forecast& forecast) {
    Json out;
    out["format"] = "orbid-prediction/1";
    out["kind"] = forecast.samples ? "samples" : "section";
    out["known_errors"] = forecast.known_errors;
    if (forecast.samples) {
        out["segments"] = json_list(forecast.segments, segment_json);
        return json_text(out);
    }
    const StepForecast& steps = forecast.steps;
    Json coordinates = rms_json(steps.coordinates);
    for (std::size_t c = 0; c < steps.coordinates.size(); ++c)
        coordinates[steps.coordinates[c].name]["expected_rms"] = steps.expected[c];
    out["steps"] = {{"count", steps.steps},
                    {"failed", steps.failed},
                    {"coordinates", coordinates},
                    {"normalised_rms", steps.normalised},
                    {"growth_per_step", steps.growth}};
    return json_text(out);
}

std::string prediction_summary(const Forecast& forecast, const std::string& heading) {
    std::string out = heading + "\n";
    if (forecast.samples) return out + samples_tables(forecast) + titled("Remarks", samples_remarks(forecast));
    const StepForecast& steps = forecast.steps;
    out += titled(fmt::format("One step ahead, {} steps", steps.steps), sections_table(steps));
    std::string remarks;
    if (steps.failed > 0) remarks += fmt::format("  {} steps cannot be simulated\n", steps.failed);
    if (std::isfinite(steps.growth))
        remarks +=
            fmt::format("  errors of readings grow {}-fold within a step\n", significant(std::exp(steps.growth), 3));
    if (!forecast.known_errors) {
        remarks +=
            "  the run has no sd of these readings: what the predictions themselves leave stands for it, an upper "
            "bound\n";
    } else if (const std::string said = judgement(steps.normalised); !said.empty()) {
        remarks += "  " + said + "\n";
    }
    return out + titled("Remarks", remarks);
}

}  // namespace orbid::apps

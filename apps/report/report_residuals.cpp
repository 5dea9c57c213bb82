#include <cmath>

#include <fmt/format.h>

#include "apps/report/html_text.hpp"
#include "apps/report/plots/record_charts.hpp"
#include "apps/report/plots/residual_structure.hpp"
#include "apps/report/report_chapter.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

using namespace detail;

std::string rms_words(const Json& list) {
    std::string words;
    for (const auto& [coordinate, value] : list.items()) {
        const Json& rms = value.is_object() ? value.at("rms") : value;
        append_words(words, coordinate + " " + (rms.is_number() ? significant(number_of(rms), 4) : "undefined"), ", ");
    }
    return words;
}

std::string prediction_table(const Json& predictions) {
    SummaryTable table({left_aligned("experiment"), left_aligned("segment"), left_aligned("role"), left_aligned("rms"),
                        explained("rms / error sd", "near 1 where the model holds")});
    for (const Json& entry : predictions) {
        const double normalised = number_at(entry, "normalised_rms");
        table.add({text_at(entry, "experiment"), text_at(entry, "segment"),
                   entry.value("fitted", false) ? "fitted" : "predicted", rms_words(block_at(entry, "rms")),
                   number_cell(normalised, 3, normalised > 2.0 ? "caution" : "")});
    }
    std::string html = html_table("How far predictions are off", table);
    if (!html.empty())
        html +=
            "<p>Each over its whole segment from one initial state, which is fitted to that segment "
            "alone. The table of errors has the rms of the estimate itself.</p>\n";
    return html;
}

/// Of the folder of a prediction: prediction.json.
std::string forecast_table(const Json& prediction) {
    SummaryTable table({left_aligned("segment"), left_aligned("initial state fitted to"), left_aligned("rms"),
                        explained("rms / error sd", "near 1 where the model holds"),
                        explained("within 2 sds for", "how far ahead errors stay small")});
    const auto add = [&table](const std::string& segment, const char* fitted, const Json& rms, double normalised,
                              const std::string& horizon) {
        table.add(
            {segment, fitted, rms_words(rms), number_cell(normalised, 3, normalised > 2.0 ? "caution" : ""), horizon});
    };
    for (const Json& segment : block_at(prediction, "segments")) {
        const std::string name = text_at(segment, "segment");
        const Json& course = block_at(segment, "course");
        add(name, "whole segment", block_at(course, "rms"), number_at(course, "normalised_rms"), "");
        const Json& ahead = block_at(segment, "ahead");
        const double horizon = number_at(ahead, "horizon");
        const std::string failed = text_at(segment, "message");
        add(name, failed.empty() ? "beginning" : failed.c_str(), block_at(ahead, "coordinates"),
            number_at(ahead, "normalised_rms"), std::isfinite(horizon) ? significant(horizon, 3) : "");
    }
    const Json& steps = block_at(prediction, "steps");
    if (!steps.empty())
        add("one step ahead", "", block_at(steps, "coordinates"), number_at(steps, "normalised_rms"), "");
    return html_table("How far the record is predicted", table);
}

double p_of(const Json& group, const char* test) {
    return number_at(block_at(group, test), "p");
}

SummaryTable::Cell p_cell(double p) {
    // Not evidence against the model for itself: of a hundred tests one falls below.
    return number_cell(p, 2, p < 0.01 ? "caution" : "");
}

std::string diagnostics_table(const Json& diagnostics) {
    SummaryTable table({left_aligned("group"), "records", "mean", "sd", "skewness",
                        explained("kurtosis", "3 for a normal distribution"),
                        explained("normal, p", "Shapiro-Wilk, or Anderson-Darling of long records"), "lag-1",
                        explained("white, p", "Ljung-Box: small where residuals follow each other"), "runs, p",
                        "outliers"});
    for (const auto& [group, entry] : diagnostics.items()) {
        const Json& normality = block_at(entry, "normality");
        double normal = p_of(normality, "shapiro_wilk");
        if (std::isnan(normal)) normal = p_of(normality, "anderson_darling");
        const auto cell = [&values = entry](const char* key, int digits) {
            return number_cell(number_at(values, key), digits);
        };
        table.add({group, cell("count", 7), cell("mean", 2), cell("sd", 4), cell("skewness", 2), cell("kurtosis", 3),
                   p_cell(normal), cell("lag1", 2), p_cell(p_of(entry, "ljung_box")), p_cell(p_of(entry, "runs")),
                   std::to_string(block_at(entry, "outliers").size())});
    }
    return html_table("What the residuals say of the error model", table);
}

std::string used_table(const Json& counts) {
    SummaryTable table({left_aligned("residuals"), "used", "lost", "rejected", "added"});
    for (const Json& count : counts) {
        const auto cell = [&count](const char* key) { return significant(number_at(count, key), 9); };
        table.add({text_at(count, "type"), cell("used"), cell("lost"), cell("rejected"), cell("added")});
    }
    return html_table("What was used", table);
}

}  // namespace

ReportChapter residual_chapter(const ReportSource& source) {
    ReportChapter chapter{"residuals", "Fit and residuals", ""};
    const auto groups = record_groups(source.run, source.residuals);
    const auto& result = source.run.result;
    chapter.html += used_table(block_at(result, "residuals"));
    const std::string thinned =
        source.residuals.size() > most_rows
            ? fmt::format(" Of {} records every {}th is in this page; residuals.csv holds them all.",
                          detail::grouped(source.residuals.size()),
                          (source.residuals.size() + most_rows - 1) / most_rows)
            : "";
    chapter.html += figure_html(prediction_chart(groups),
                                "Observed values (dots) and what the estimated model predicts (line). Of cycles, "
                                "observed against predicted points." +
                                    thinned);
    chapter.html += figure_html(waveform_chart(source.run, source.residuals),
                                "Measured steady states (dots) and computed ones (lines) over one turn of the orbit.");
    const std::vector<ResidualRow> predicted = stored_predictions(source.run);
    chapter.html +=
        figure_html(segment_chart(record_groups(source.run, predicted, predicted.size())),
                    "Segments that took no part in the fit: measured (dots), predicted from an initial state "
                    "that was fitted to them, and what is left.");
    chapter.html += prediction_table(block_at(result, "prediction"));
    if (source.run.prediction) chapter.html += forecast_table(*source.run.prediction);
    std::string residuals = figure_html(residual_chart(groups),
                                        "What is left, in standard deviations of its error. 19 of 20 should lie within "
                                        "the dashed lines, without a course that the eye can follow.");
    residuals += figure_html(quantile_chart(groups),
                             "The same values in their order, against those of a normal distribution: on the line when "
                             "errors are normal, above it on the right and below on the left when their tails are "
                             "heavy.");
    const auto all = record_groups(source.run, source.residuals, source.residuals.size());
    residuals += figure_html(autocorrelation_chart(all),
                             "How residuals follow each other. Of white noise 19 of 20 lags lie within the dashed "
                             "lines; more say that the model, or the error model, leaves something out.");
    residuals += figure_html(spectrum_chart(all),
                             "At which frequencies: 1 everywhere for white noise. A peak at a resonance or at the "
                             "frequency of the forcing points to the model, a rise at low ones to a drift.");
    residuals += figure_html(dependence_chart(source.run, groups),
                             "What is left against what drives the model and what it does: each measured input, each "
                             "coordinate as predicted, its rate of change. A mean that leaves the line at 0 is a term "
                             "that the equations lack: against a rate a friction, against a coordinate a spring.");
    residuals += diagnostics_table(block_at(result, "diagnostics"));
    chapter.html += html_headed(3, "Residuals", residuals);
    return chapter;
}

}  // namespace orbid::apps

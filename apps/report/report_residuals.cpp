#include <cmath>

#include <fmt/format.h>

#include "apps/report/html_text.hpp"
#include "apps/report/plots/record_charts.hpp"
#include "apps/report/report_chapter.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

using namespace detail;

std::string prediction_table(const Json& predictions) {
    HtmlTable table("How far predictions are off", {{"experiment", false},
                                                    {"segment", false},
                                                    {"role", false},
                                                    {"rms", false},
                                                    {"rms / error sd", true, "near 1 where the model holds"}});
    for (const Json& entry : predictions) {
        std::string rms;
        if (const Json* list = filled(entry, "rms")) {
            for (const auto& [coordinate, value] : list->items())
                rms += fmt::format("{}{} {}", rms.empty() ? "" : ", ", coordinate,
                                   value.is_number() ? significant(value.get<double>(), 4) : "undefined");
        }
        const double normalised = number_at(entry, "normalised_rms");
        table.add({text_at(entry, "experiment"), text_at(entry, "segment"),
                   entry.value("fitted", false) ? "fitted" : "predicted", rms,
                   number_cell(normalised, 3, normalised > 2.0 ? "caution" : "")});
    }
    return table.html();
}

double p_of(const Json& group, const char* test) {
    const Json* found = filled(group, test);
    return found == nullptr ? std::nan("") : number_at(*found, "p");
}

HtmlTable::Cell p_cell(double p) {
    // Not evidence against the model for itself: of a hundred tests one falls below.
    return number_cell(p, 2, p < 0.01 ? "caution" : "");
}

std::string diagnostics_table(const Json& diagnostics) {
    HtmlTable table("What the residuals say of the error model",
                    {{"group", false},
                     {"records"},
                     {"mean"},
                     {"sd"},
                     {"skewness"},
                     {"kurtosis", true, "3 for a normal distribution"},
                     {"normal, p", true, "Shapiro-Wilk, or Anderson-Darling of long records"},
                     {"lag-1"},
                     {"white, p", true, "Ljung-Box: small where residuals follow each other"},
                     {"runs, p"},
                     {"outliers"}});
    for (const auto& [group, entry] : diagnostics.items()) {
        const Json* normality = filled(entry, "normality");
        double normal = normality == nullptr ? std::nan("") : p_of(*normality, "shapiro_wilk");
        if (std::isnan(normal) && normality != nullptr) normal = p_of(*normality, "anderson_darling");
        const Json* outliers = filled(entry, "outliers");
        const auto cell = [&values = entry](const char* key, int digits) {
            return number_cell(number_at(values, key), digits);
        };
        table.add({group, cell("count", 7), cell("mean", 2), cell("sd", 4), cell("skewness", 2), cell("kurtosis", 3),
                   p_cell(normal), cell("lag1", 2), p_cell(p_of(entry, "ljung_box")), p_cell(p_of(entry, "runs")),
                   std::to_string(outliers == nullptr ? 0 : outliers->size())});
    }
    return table.html();
}

std::string used_table(const Json& counts) {
    HtmlTable table("What was used", {{"residuals", false}, {"used"}, {"lost"}, {"rejected"}, {"added"}});
    for (const Json& count : counts) {
        const auto cell = [&count](const char* key) { return significant(number_at(count, key), 9); };
        table.add({text_at(count, "type"), cell("used"), cell("lost"), cell("rejected"), cell("added")});
    }
    return table.html();
}

}  // namespace

ReportChapter residual_chapter(const ReportSource& source) {
    ReportChapter chapter{"residuals", "Fit and residuals", ""};
    const auto groups = record_groups(source.run, source.residuals);
    const Json* result = source.run.result ? &*source.run.result : nullptr;
    if (result != nullptr) {
        if (const Json* list = filled(*result, "residuals")) chapter.html += used_table(*list);
    }
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
    if (result != nullptr) {
        if (const Json* list = filled(*result, "prediction")) chapter.html += prediction_table(*list);
    }
    std::string residuals = figure_html(residual_chart(groups),
                                        "What is left, in standard deviations of its error. 19 of 20 should lie within "
                                        "the dashed lines, without a course that the eye can follow.");
    residuals += figure_html(quantile_chart(groups),
                             "The same values in their order, against those of a normal distribution: on the line when "
                             "errors are normal, above it on the right and below on the left when their tails are "
                             "heavy.");
    if (result != nullptr) {
        if (const Json* list = filled(*result, "diagnostics")) residuals += diagnostics_table(*list);
    }
    chapter.html += html_headed(3, "Residuals", residuals);
    return chapter;
}

}  // namespace orbid::apps

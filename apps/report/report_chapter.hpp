#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

#include "apps/report/report_chart.hpp"
#include "apps/report/report_points.hpp"
#include "apps/results/result_file.hpp"
#include "apps/stored_run/stored_run.hpp"

namespace orbid::apps {

/// What the chapters of a report are written from: a stored run, and what several chapters read, read once.
struct ReportSource {
    const StoredRun& run;
    std::vector<ResidualRow> residuals;               ///< residuals.csv
    std::map<std::string, std::string> still_plots;   ///< SVG by name, as plot_catalog drew it
    std::map<std::string, std::string> descriptions;  ///< of these plots, one sentence each
};

/// A part of the report; one without content is left out with its heading.
struct ReportChapter {
    std::string id;  ///< for links
    std::string heading;
    std::string html;
};

/// What was estimated, how far to trust it, what the data do not determine, in plain words.
[[nodiscard]] std::string verdict_html(const ReportSource& source);
/// Parameters, derived quantities, error scales, initial states.
[[nodiscard]] ReportChapter parameter_chapter(const ReportSource& source);
/// Correlations, singular values, directions that the data do not determine.
[[nodiscard]] ReportChapter identifiability_chapter(const ReportSource& source);
/// Profiles, marginals, draws, several starts.
[[nodiscard]] ReportChapter posterior_chapter(const ReportSource& source);
/// The section with its periodic points, and the list of cycles.
[[nodiscard]] ReportChapter section_chapter(const ReportSource& source);
/// Observed against predicted values, residuals and what they say about the error model.
[[nodiscard]] ReportChapter residual_chapter(const ReportSource& source);
/// Stages, iterations, matching at the nodes, other models.
[[nodiscard]] ReportChapter course_chapter(const ReportSource& source);
/// Orbits that were computed from the model, and branches of them.
[[nodiscard]] ReportChapter branch_chapter(const ReportSource& source);
/// The job, versions, seeds, fingerprints, times.
[[nodiscard]] ReportChapter provenance_chapter(const ReportSource& source);

/// A figure: the still picture of plot_catalog under the chart's name, the live chart's data, a caption. Nothing where
/// there is neither.
/// @param blocks  of a chart with a layer of kind "density".
[[nodiscard]] std::string figure_html(const ReportSource& source, const Chart& chart, std::string_view caption,
                                      const PointBlocks* blocks = nullptr);

namespace detail {

using Json = nlohmann::ordered_json;

/// A member of an object as a number: nan where it is absent, null or no number.
[[nodiscard]] double number_at(const Json& object, std::string_view key);
/// As text; empty where it is absent, null or no text.
[[nodiscard]] std::string text_at(const Json& object, std::string_view key);
/// A member that is an object or a list with something in it, else null.
[[nodiscard]] const Json* filled(const Json& object, std::string_view key);
/// The same of an object that may not be there.
[[nodiscard]] inline const Json* filled(const Json* object, std::string_view key) {
    return object == nullptr ? nullptr : filled(*object, key);
}
/// 1048576 -> "1 048 576", with spaces that do not break.
[[nodiscard]] std::string grouped(std::size_t value);
/// "1 cycle", "3 cycles".
[[nodiscard]] std::string grouped_count(std::size_t count, std::string_view noun);

}  // namespace detail

}  // namespace orbid::apps

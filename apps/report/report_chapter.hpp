#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "apps/report/plots/json_member.hpp"
#include "apps/report/report_frame.hpp"
#include "apps/results/result_file.hpp"
#include "apps/stored_run/stored_run.hpp"

namespace orbid::apps {

/// What the chapters of a report are written from: a stored run, and what several chapters read, read once.
struct ReportSource {
    const StoredRun& run;
    std::vector<ResidualRow> residuals;  ///< residuals.csv
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

}  // namespace orbid::apps

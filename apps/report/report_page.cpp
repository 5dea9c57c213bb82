#include "apps/report/report_page.hpp"

#include <array>

#include "apps/report/report_chapter.hpp"

namespace orbid::apps {

namespace {

std::string subtitle(const StoredRun& run) {
    std::string out = detail::text_at(detail::block_at(run.job, "model"), "name");
    if (run.result) append_words(out, "status: " + detail::text_at(*run.result, "status"), " · ");
    if (run.job.contains("versions"))
        append_words(out, "orbid " + detail::text_at(run.job.at("versions"), "orbid"), " · ");
    return out;
}

}  // namespace

std::string report_html(const StoredRun& run) {
    const ReportSource source{run, stored_residuals(run)};
    const std::array chapters{parameter_chapter(source),       section_chapter(source),   residual_chapter(source),
                              identifiability_chapter(source), posterior_chapter(source), course_chapter(source),
                              branch_chapter(source),          provenance_chapter(source)};
    return report_page({.title = run.title().empty() ? std::string("Report") : run.title(),
                        .about = subtitle(run),
                        .verdict = verdict_html(source)},
                       chapters);
}

}  // namespace orbid::apps

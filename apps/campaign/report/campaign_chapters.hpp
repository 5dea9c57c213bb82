#pragma once

#include <string>

#include "apps/campaign/report/campaign_findings.hpp"
#include "apps/report/report_frame.hpp"

namespace orbid::apps {

/// What has been done, whether the intervals hold, what failed.
/// @param written  a sentence about the page itself; empty: none.
[[nodiscard]] std::string campaign_verdict(const CampaignFindings& findings, const std::string& written);
/// Settings with their counts, and each parameter by setting.
[[nodiscard]] ReportChapter settings_chapter(const CampaignFindings& findings);
/// Coverage, errors over sds, errors over bounds; nothing without truths.
[[nodiscard]] ReportChapter coverage_chapter(const CampaignFindings& findings);
/// Each parameter against each thing that varies.
[[nodiscard]] ReportChapter dependence_chapter(const CampaignFindings& findings);
/// Why tasks failed or have no valid answer.
[[nodiscard]] ReportChapter failure_chapter(const CampaignFindings& findings);
/// How long tasks took.
[[nodiscard]] ReportChapter time_chapter(const CampaignFindings& findings);
/// Where everything comes from.
[[nodiscard]] ReportChapter origin_chapter(const CampaignFindings& findings);

}  // namespace orbid::apps

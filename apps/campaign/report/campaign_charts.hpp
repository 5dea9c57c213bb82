#pragma once

#include "apps/campaign/report/campaign_findings.hpp"
#include "apps/drawing/chart.hpp"

namespace orbid::apps {

/// Groups of which a picture shows each by name.
inline constexpr std::size_t most_drawn_groups = 30;

/// "noise 0.01, file a.csv"; empty when nothing makes groups.
[[nodiscard]] std::string group_name(const CampaignFindings& findings, const GroupStatistics& group);

/// How often intervals hold the truth, with binomial intervals: all parameters; each of them by setting.
[[nodiscard]] Chart coverage_chart(const CampaignFindings& findings);
/// (estimate - truth) / sd beside the standard normal density, a view for each parameter.
[[nodiscard]] Chart z_chart(const CampaignFindings& findings);
/// Root mean square error over the least one possible, by setting, a view for each parameter.
[[nodiscard]] Chart bound_chart(const CampaignFindings& findings);
/// Each parameter against what varies along an axis: every estimate with its interval, or bands of many.
[[nodiscard]] Chart dependence_chart(const CampaignFindings& findings, std::size_t axis);
/// How long tasks took.
[[nodiscard]] Chart time_chart(const CampaignFindings& findings);

}  // namespace orbid::apps

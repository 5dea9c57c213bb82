#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "apps/campaign/plan/campaign.hpp"
#include "apps/documents/json_document.hpp"
#include "apps/documents/schema.hpp"
#include "apps/job/job.hpp"

namespace orbid::apps {

/// A campaign, or all its problems.
struct CampaignReading {
    std::optional<Campaign> campaign;  ///< empty when there are problems
    std::vector<Problem> problems;     ///< by line

    /// 0; 2 when the campaign is invalid; 3 when only files are missing.
    [[nodiscard]] int exit_code() const;
};

/// Reads and checks a campaign: syntax, keys, types, ranges, existence of jobs and data files, and every job that its
/// settings lead to (the first replicate of each, of at most `most_checked`, the first and last ones).
/// @param text    JSON with comments.
/// @param source  path of the file: relative paths start at its folder.
[[nodiscard]] CampaignReading read_campaign(std::string_view text, const std::filesystem::path& source);

/// Whether a file is meant as a campaign: an object with "kind" and one of "job", "jobs", "run", which no job has.
[[nodiscard]] bool is_campaign(std::string_view text);

/// What a campaign would run, for people: one line for each thing that varies.
[[nodiscard]] std::string campaign_summary(const Campaign& campaign);

/// Whether a job makes all its data: what they were made by is then known.
[[nodiscard]] bool simulates_all_data(const Job& job);

/// What a campaign may contain; `orbid schema --campaign` and docs/campaign_reference.md follow it.
[[nodiscard]] const ValueSchema& campaign_description();

}  // namespace orbid::apps

#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <unordered_map>
#include <vector>

#include "apps/campaign/journal/journal.hpp"
#include "apps/campaign/tables/campaign_status.hpp"
#include "apps/campaign/tables/group_statistics.hpp"

namespace orbid::apps {

/// What varies, as numbers along an axis.
struct VariedAxis {
    std::size_t column = 0;          ///< of JournalHead::varied
    bool numeric = true;             ///< all values are numbers; else a value is the place of its name
    std::vector<std::string> names;  ///< of values that are no numbers, in the order of their first appearance
    std::vector<double> values;      ///< one for each valid task
    std::unordered_map<std::string, double> places;  ///< of names
};

/// The estimates of one parameter in all valid tasks.
struct ParameterSeries {
    std::vector<std::uint32_t> rows;  ///< which valid task, into VariedAxis::values
    std::vector<double> values;
    std::vector<double> lower;  ///< kept for few tasks alone: a picture shows intervals of these
    std::vector<double> upper;
    std::vector<double> truths;
    std::vector<std::int64_t> z_counts;  ///< of (value - truth) / sd, by z_bin()

    static constexpr double z_reach = 5.0;
    static constexpr std::size_t z_bins = 40;  ///< from -z_reach to z_reach; two more for what is beyond
    [[nodiscard]] static std::size_t z_bin(double z);
};

/// All that the report of a campaign shows, gathered in one pass over its tasks.
struct CampaignFindings {
    const JournalHead* head = nullptr;
    CampaignStatus status;
    CampaignGroups groups{{}};
    std::vector<VariedAxis> axes;
    std::vector<ParameterSeries> parameters;  ///< by the numbers of groups.names()
    std::vector<float> seconds;               ///< of tasks that ended
    std::vector<std::int64_t> numbers;        ///< of valid tasks

    /// Tasks of which a picture shows every interval.
    static constexpr std::size_t few = 500;
    /// Settings that are told apart; tasks of further ones count in sums over all alone.
    static constexpr std::size_t most_groups = 1000;
};

/// @param interrupted  asked all along. @throws models::Stopped if it says so; JournalDamaged
[[nodiscard]] CampaignFindings campaign_findings(const Journal& journal, const std::function<bool()>& interrupted = {});

}  // namespace orbid::apps

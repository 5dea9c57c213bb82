#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <unordered_map>
#include <vector>

#include "apps/campaign/journal/journal.hpp"
#include "apps/campaign/tables/binomial_interval.hpp"

namespace orbid::apps {

/// Mean and spread of numbers, fed one by one (Welford).
class RunningMean {
public:
    void add(double value) {
        if (std::isnan(value)) return;
        ++count_;
        const double from_mean = value - mean_;
        mean_ += from_mean / static_cast<double>(count_);
        squares_ += from_mean * (value - mean_);
    }
    [[nodiscard]] std::int64_t count() const { return count_; }
    /// nan without numbers.
    [[nodiscard]] double mean() const { return count_ > 0 ? mean_ : std::nan(""); }
    /// With count - 1 below the root; nan for fewer than two numbers.
    [[nodiscard]] double sd() const {
        return count_ > 1 ? std::sqrt(squares_ / static_cast<double>(count_ - 1)) : std::nan("");
    }

private:
    std::int64_t count_ = 0;
    double mean_ = 0;
    double squares_ = 0;
};

/// The estimates of one parameter in several tasks.
struct ParameterStatistics {
    RunningMean value;
    RunningMean sd;              ///< as reported
    RunningMean z2;              ///< ((value - truth) / sd)^2
    RunningMean error2;          ///< (value - truth)^2
    RunningMean over_bound2;     ///< ((value - truth) / bound)^2
    std::int64_t intervals = 0;  ///< with a truth
    std::int64_t covered = 0;    ///< that hold it

    void add(const TaskParameter& parameter);
    /// nan without truths.
    [[nodiscard]] double coverage() const {
        return intervals > 0 ? static_cast<double>(covered) / static_cast<double>(intervals) : std::nan("");
    }
    [[nodiscard]] BinomialInterval coverage_interval() const { return binomial_interval(covered, intervals); }
    [[nodiscard]] double rms_z() const { return std::sqrt(z2.mean()); }
    [[nodiscard]] double rms_over_bound() const { return std::sqrt(over_bound2.mean()); }
};

/// Tasks of the same setting.
struct GroupStatistics {
    std::vector<std::string> values;  ///< JSON texts of the columns that make groups
    std::int64_t first = 0;           ///< number of a task
    std::int64_t tasks = 0;
    std::int64_t done = 0;
    std::int64_t converged = 0;  ///< of those that are done
    std::int64_t valid = 0;      ///< done with exit code 0: these are in the statistics
    std::int64_t failed = 0;
    RunningMean seconds;                          ///< of all that ended
    std::vector<ParameterStatistics> parameters;  ///< by the number of the name in CampaignGroups::names()

    /// Nothing was estimated: nan everywhere.
    [[nodiscard]] const ParameterStatistics& parameter(std::size_t name) const;
};

/// Whether the estimates of a task count in statistics: done, with exit code 0.
[[nodiscard]] bool is_valid(const TaskOutcome& outcome);

/// The tasks of a campaign in groups of equal values of what varies, replicates apart; in the order of the campaign.
class CampaignGroups {
public:
    /// @param most  groups at most: tasks of further settings are counted by left_out() alone.
    explicit CampaignGroups(const std::vector<VariedColumn>& varied, std::size_t most = static_cast<std::size_t>(-1));

    /// Rows in ascending order, so that sums have a fixed order.
    void add(const Journal::Row& row);

    /// Numbers of the columns that make groups.
    [[nodiscard]] const std::vector<std::size_t>& columns() const { return columns_; }
    /// Names of parameters in the order of their first appearance.
    [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
    [[nodiscard]] const std::vector<GroupStatistics>& groups() const { return groups_; }
    /// All tasks as one group.
    [[nodiscard]] const GroupStatistics& all() const { return all_; }
    [[nodiscard]] std::int64_t left_out() const { return left_out_; }

private:
    [[nodiscard]] std::size_t name_number(const std::string& name);
    void add_to(GroupStatistics& group, const Journal::Row& row);
    [[nodiscard]] GroupStatistics* group_of(const Journal::Row& row);

    std::vector<std::size_t> columns_;
    std::size_t most_;
    std::vector<std::string> names_;
    std::unordered_map<std::string, std::size_t> name_numbers_;
    std::unordered_map<std::string, std::size_t> group_numbers_;
    std::vector<GroupStatistics> groups_;
    GroupStatistics all_;
    std::int64_t left_out_ = 0;
    std::size_t last_ = 0;  ///< group of the row before
    std::string last_key_;
    std::string key_;
};

}  // namespace orbid::apps

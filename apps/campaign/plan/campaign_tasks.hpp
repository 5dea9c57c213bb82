#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "apps/campaign/journal/journal.hpp"
#include "apps/campaign/plan/campaign.hpp"

namespace orbid::apps {

/// The tasks of a campaign. Each follows from its number alone.
class CampaignTasks {
public:
    /// @throws std::invalid_argument when a job is not JSON, or a pointer leads nowhere in it; what() names both.
    explicit CampaignTasks(Campaign campaign);

    [[nodiscard]] const Campaign& campaign() const { return campaign_; }
    [[nodiscard]] std::int64_t count() const { return count_; }
    /// Columns of tables, in the order of TaskPlan::values: the job, what varies, what is drawn, the replicate.
    [[nodiscard]] const std::vector<VariedColumn>& columns() const { return columns_; }
    [[nodiscard]] TaskPlan plan(std::int64_t number) const;
    /// The job of a task, as text.
    [[nodiscard]] std::string job_text(std::int64_t number) const;
    [[nodiscard]] const BaseJob& base(std::int64_t number) const { return campaign_.jobs[place(number).job]; }
    /// Known values of its parameters.
    [[nodiscard]] std::vector<KnownValue> known(std::int64_t number) const;
    /// From 0.
    [[nodiscard]] std::int64_t replicate(std::int64_t number) const { return place(number).replicate; }
    /// Tasks of equal number here differ by replicate alone: they take about the same time.
    [[nodiscard]] std::int64_t group(std::int64_t number) const { return number / campaign_.replicates; }

    /// How many tasks a campaign has; more than `most`: nothing.
    static constexpr std::int64_t most = 10'000'000;
    /// As a number, which may be beyond any that can be run.
    [[nodiscard]] static double count_of(const Campaign& campaign);

private:
    struct Place {
        std::size_t job = 0;
        std::vector<std::size_t> settings;  ///< one per factor
        std::int64_t replicate = 0;
    };
    [[nodiscard]] Place place(std::int64_t number) const;
    [[nodiscard]] double drawn(std::size_t draw, std::int64_t replicate) const;

    Campaign campaign_;
    std::int64_t count_ = 0;
    std::vector<VariedColumn> columns_;
    std::vector<nlohmann::ordered_json> bases_;
    std::vector<std::string> base_keys_;  ///< SHA-256 of each job's text and source
};

/// Puts a value into a job. The object or list that holds it must be there, the last key need not. An object with a
/// "value" takes a plain value there.
/// @throws std::invalid_argument naming the part of the pointer that leads nowhere.
void set_value(nlohmann::ordered_json& job, const std::string& pointer, const nlohmann::ordered_json& value);

/// Multiplies every number at a place of a job, those of an object or a list there too.
/// @throws std::invalid_argument when there is no number; what() names the pointer.
void multiply_value(nlohmann::ordered_json& job, const std::string& pointer, double factor);

}  // namespace orbid::apps

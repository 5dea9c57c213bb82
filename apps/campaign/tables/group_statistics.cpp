#include "apps/campaign/tables/group_statistics.hpp"

namespace orbid::apps {

void ParameterStatistics::add(const TaskParameter& parameter) {
    value.add(parameter.value);
    sd.add(parameter.sd);
    if (std::isnan(parameter.truth)) return;
    const double error = parameter.value - parameter.truth;
    error2.add(error * error);
    if (parameter.sd > 0) z2.add(error * error / (parameter.sd * parameter.sd));
    if (parameter.bound > 0) over_bound2.add(error * error / (parameter.bound * parameter.bound));
    if (std::isnan(parameter.lower) || std::isnan(parameter.upper)) return;
    ++intervals;
    covered += parameter.lower <= parameter.truth && parameter.truth <= parameter.upper;
}

const ParameterStatistics& GroupStatistics::parameter(std::size_t name) const {
    static const ParameterStatistics none;
    return name < parameters.size() ? parameters[name] : none;
}

bool is_valid(const TaskOutcome& outcome) {
    return outcome.state == TaskState::done && outcome.exit_code == 0;
}

CampaignGroups::CampaignGroups(const std::vector<VariedColumn>& varied, std::size_t most) : most_(most) {
    for (std::size_t k = 0; k < varied.size(); ++k)
        if (!varied[k].replicate) columns_.push_back(k);
}

std::size_t CampaignGroups::name_number(const std::string& name) {
    const auto [found, added] = name_numbers_.try_emplace(name, names_.size());
    if (added) names_.push_back(name);
    return found->second;
}

GroupStatistics* CampaignGroups::group_of(const Journal::Row& row) {
    key_.clear();
    for (const std::size_t column : columns_)
        key_.append(row.plan.values[column]) += '\n';
    if (!groups_.empty() && key_ == last_key_) return &groups_[last_];
    auto found = group_numbers_.find(key_);
    if (found == group_numbers_.end()) {
        if (groups_.size() >= most_) return nullptr;
        found = group_numbers_.emplace(key_, groups_.size()).first;
        GroupStatistics& group = groups_.emplace_back();
        group.first = row.plan.number;
        for (const std::size_t column : columns_)
            group.values.push_back(row.plan.values[column]);
    }
    last_ = found->second;
    last_key_ = key_;
    return &groups_[last_];
}

void CampaignGroups::add_to(GroupStatistics& group, const Journal::Row& row) {
    ++group.tasks;
    const TaskOutcome& outcome = row.outcome;
    if (outcome.state == TaskState::waiting) return;
    group.seconds.add(outcome.seconds);
    group.failed += outcome.state == TaskState::failed;
    group.done += outcome.state == TaskState::done;
    group.converged += outcome.state == TaskState::done && outcome.status == "converged";
    if (!is_valid(outcome)) return;
    ++group.valid;
    for (const TaskParameter& parameter : outcome.parameters) {
        const std::size_t number = name_number(parameter.name);
        if (number >= group.parameters.size()) group.parameters.resize(number + 1);
        group.parameters[number].add(parameter);
    }
}

void CampaignGroups::add(const Journal::Row& row) {
    add_to(all_, row);
    if (GroupStatistics* group = group_of(row)) {
        add_to(*group, row);
    } else {
        ++left_out_;
    }
}

}  // namespace orbid::apps

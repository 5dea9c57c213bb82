#include "apps/campaign/report/campaign_findings.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "apps/campaign/tables/campaign_table.hpp"
#include "models/system/stopped.hpp"

namespace orbid::apps {
namespace {

/// The whole text as a number; nan when it is none.
double number_in(const std::string& text) {
    double value = std::nan("");
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    return error == std::errc() && end == text.data() + text.size() ? value : std::nan("");
}

/// A value of the axis; the first one that is no number makes all of them names.
double place_of(VariedAxis& axis, const std::string& json) {
    if (axis.numeric) {
        const double value = number_in(json);
        if (!std::isnan(value)) return value;
        if (!axis.values.empty()) return std::nan("");
        axis.numeric = false;
    }
    const auto [found, added] = axis.places.try_emplace(json, static_cast<double>(axis.names.size()));
    if (added) axis.names.push_back(varied_text(json));
    return found->second;
}

/// A seed is no quantity that anything could depend on.
bool is_quantity(const VariedColumn& column) {
    return !column.pointer.ends_with("/seed") && !(column.replicate && column.pointer.empty());
}

void add_estimate(ParameterSeries& series, const TaskParameter& p, std::uint32_t row) {
    if (std::isnan(p.value)) return;
    series.rows.push_back(row);
    series.values.push_back(p.value);
    series.truths.push_back(p.truth);
    if (series.values.size() <= CampaignFindings::few) {
        series.lower.push_back(p.lower);
        series.upper.push_back(p.upper);
    }
    const double z = (p.value - p.truth) / p.sd;
    if (!std::isfinite(z)) return;
    series.z_counts.resize(ParameterSeries::z_bins + 2, 0);
    ++series.z_counts[ParameterSeries::z_bin(z)];
}

/// The numbers of parameters by name, mostly in the order of the task before.
class NameNumbers {
public:
    std::size_t operator()(const std::vector<std::string>& names, const std::string& name, std::size_t guess) {
        if (guess < names.size() && names[guess] == name) return guess;
        return static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin());
    }
};

}  // namespace

std::size_t ParameterSeries::z_bin(double z) {
    const double place = (z + z_reach) / (2 * z_reach) * static_cast<double>(z_bins);
    if (place < 0) return z_bins;
    if (place >= static_cast<double>(z_bins)) return z_bins + 1;
    return static_cast<std::size_t>(place);
}

CampaignFindings campaign_findings(const Journal& journal, const std::function<bool()>& interrupted) {
    CampaignFindings out;
    out.head = &journal.head();
    out.status = read_campaign_status(journal);
    out.groups = CampaignGroups(out.head->varied, CampaignFindings::most_groups);
    for (std::size_t k = 0; k < out.head->varied.size(); ++k)
        if (is_quantity(out.head->varied[k]))
            out.axes.push_back({.column = k, .names = {}, .values = {}, .places = {}});
    NameNumbers number_of;
    journal.each_row([&](const Journal::Row& row) {
        models::stop_if_asked(interrupted);
        out.groups.add(row);
        if (row.outcome.state != TaskState::waiting) out.seconds.push_back(static_cast<float>(row.outcome.seconds));
        if (!is_valid(row.outcome)) return;
        for (VariedAxis& axis : out.axes)
            axis.values.push_back(place_of(axis, row.plan.values[axis.column]));
        const auto index = static_cast<std::uint32_t>(out.numbers.size());
        out.numbers.push_back(row.plan.number);
        out.parameters.resize(out.groups.names().size());
        std::size_t guess = 0;
        for (const TaskParameter& parameter : row.outcome.parameters)
            add_estimate(out.parameters[number_of(out.groups.names(), parameter.name, guess++)], parameter, index);
    });
    return out;
}

}  // namespace orbid::apps

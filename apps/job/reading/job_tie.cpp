#include <algorithm>
#include <limits>

#include "apps/job/job_parts.hpp"

namespace orbid::apps {

namespace {

bool has_own(const DataJob& data, Eigen::Index parameter) {
    return std::find(data.free.begin(), data.free.end(), parameter) != data.free.end();
}

}  // namespace

void read_tie(const ValueReader& tie, FreeParameterJob& free) {
    estimator::FreeParameter& value = free.value;
    if (tie.is(JsonValue::Kind::string)) {
        value.tied_to = tie.text().value_or("");
        return;
    }
    ObjectReader inner(tie);
    if (const auto to = inner.find("to")) value.tied_to = to->text().value_or("");
    if (const auto factor = inner.find("factor")) value.tie_factor = factor->number().value_or(1.0);
    inner.finish();
}

void resolve_tie(const ValueReader& at, const Job& job, const EstimateJob& estimate, FreeParameterJob& free) {
    estimator::FreeParameter& value = free.value;
    const auto& all = estimate.parameters;
    const auto leader = std::find_if(all.begin(), all.end(),
                                     [&](const FreeParameterJob& other) { return other.value.name == value.tied_to; });
    if (value.tied_to == value.name) {
        at.report(fmt::format("{} is tied to itself", value.name));
        return;
    }
    if (leader == all.end()) {
        std::vector<std::string> names;
        for (const FreeParameterJob& other : all)
            if (other.value.name != value.name) names.push_back(other.value.name);
        at.report(fmt::format("\"{}\" is no estimated parameter{}", value.tied_to, suggestion(value.tied_to, names)));
        return;
    }
    if (!leader->value.tied_to.empty()) {
        at.report(
            fmt::format("{} is tied to {} itself: tie both to that one", leader->value.name, leader->value.tied_to));
        return;
    }
    for (const DataJob& data : job.data) {
        if (!has_own(data, leader->parameter) || has_own(data, free.parameter)) continue;
        at.report(fmt::format("{} is free in \"{}\": list {} in \"free\" there too", leader->value.name, data.name,
                              value.name));
    }
    value.start = value.tie_factor * leader->value.start;
    const models::Parameter& entry = job.model.system->parameters()[static_cast<std::size_t>(free.parameter)];
    if (!models::contains(entry.domain, value.start))
        at.report(fmt::format("start {} of {} ({}), {} times that of {}: must be {}", value.start, value.name,
                              entry.description, value.tie_factor, leader->value.name, models::rule(entry.domain)));
    // Zero is no value of a positive parameter, and no bound that the followed one reaches on a log scale.
    value.scale = leader->value.scale;
    value.lower = entry.domain == models::Domain::real ? -std::numeric_limits<double>::infinity() : 0.0;
}

}  // namespace orbid::apps

#include <algorithm>

#include "apps/job/data_job.hpp"
#include "apps/job/estimate_job.hpp"
#include "apps/job/job_parts.hpp"
#include "apps/job/orbits_job.hpp"

namespace orbid::apps {

namespace {

using Sampling = orbits::Series::Sampling;
using Kind = StageJob::Kind;

std::vector<ResidualType> present_types(const EstimateJob& estimate) {
    std::vector<ResidualType> present;
    if (estimate.cycles) present.push_back(ResidualType::cycles);
    if (estimate.series) present.push_back(ResidualType::series);
    if (estimate.waveform) present.push_back(ResidualType::waveform);
    return present;
}

bool is_searched(const Job& job) {
    return job.orbits && !job.orbits->file;
}

/// A prediction starts from states that readings say.
bool has_readings(const Job& job, const EstimateJob& estimate) {
    return (estimate.series && !estimate.series->data.empty()) || is_searched(job);
}

/// A residual named in a stage: present, and in no stage before.
void add_type(const ValueReader& item, std::size_t choice, const std::vector<ResidualType>& present,
              std::vector<ResidualType>& used, StageJob& stage) {
    const auto type = static_cast<ResidualType>(choice);
    if (std::find(present.begin(), present.end(), type) == present.end()) {
        item.report(fmt::format("there is no residual of type {} in \"residuals\"", item.value().text));
    } else if (std::find(used.begin(), used.end(), type) != used.end()) {
        item.report(fmt::format("\"{}\" is listed twice", item.value().text));
    }
    used.push_back(type);
    stage.residuals.push_back(type);
}

void read_stages(const ValueReader& value, const Job& job, EstimateJob& estimate) {
    const auto present = present_types(estimate);
    std::vector<ResidualType> used;
    std::vector<std::string> names = residual_type_names;
    names.insert(names.end(), {"prediction", "harvest"});
    for (const ValueReader& item : value.items()) {
        StageJob stage;
        if (item.is(JsonValue::Kind::array)) {
            for (const ValueReader& inner : item.items())
                if (const auto choice = inner.choice(residual_type_names))
                    add_type(inner, *choice, present, used, stage);
            std::sort(stage.residuals.begin(), stage.residuals.end());
            estimate.strategy.push_back(std::move(stage));
            continue;
        }
        const auto choice = item.choice(names);
        if (!choice) continue;
        if (*choice < residual_type_names.size()) {
            add_type(item, *choice, present, used, stage);
        } else if (names[*choice] == "prediction") {
            stage.kind = Kind::prediction;
            if (!estimate.strategy.empty()) item.report("the prediction gives a start: it must be the first stage");
            if (!has_readings(job, estimate))
                item.report("needs a series: a residual of type series, or \"orbits\" that are searched for");
        } else {
            stage.kind = Kind::harvest;
            stage.residuals = {ResidualType::cycles};
            if (!is_searched(job)) item.report("needs \"orbits\" that are searched for in a series");
            const bool known = std::any_of(estimate.strategy.begin(), estimate.strategy.end(),
                                           [](const StageJob& one) { return one.uses(ResidualType::cycles); });
            if (!known) item.report("must come after \"cycles\": it looks for what their estimate points to");
        }
        estimate.strategy.push_back(std::move(stage));
    }
    if (!value.is(JsonValue::Kind::array)) return;
    for (const ResidualType type : present) {
        if (std::find(used.begin(), used.end(), type) != used.end()) continue;
        value.report(fmt::format("must name every type of \"residuals\": there is no \"{}\"",
                                 residual_type_names[static_cast<std::size_t>(type)]));
    }
}

}  // namespace

void add_usual_residuals(const ValueReader& at, const ValueSchema* residuals, const Job& job, EstimateJob& estimate) {
    JsonValue list;
    list.kind = JsonValue::Kind::array;
    list.place = at.value().place;
    const auto add = [&](const char* name) {
        JsonValue type;
        type.kind = JsonValue::Kind::string;
        type.text = name;
        type.place = list.place;
        JsonValue residual;
        residual.kind = JsonValue::Kind::object;
        residual.place = list.place;
        residual.members.push_back({"type", list.place, type});
        list.items.push_back(std::move(residual));
    };
    if (job.orbits) add("cycles");
    if (!job.data.empty()) add("series");
    if (list.items.empty()) {
        at.report("\"auto\" needs \"data\", or \"orbits\" with a file of cycles, to estimate from");
        return;
    }
    read_residuals(at.standing_for(list, residuals), job, estimate);
}

void read_strategy(ObjectReader& object, const Job& job, EstimateJob& estimate) {
    const auto value = object.find("strategy");
    if (!value) {
        // Everything at once.
        const auto present = present_types(estimate);
        if (!present.empty()) estimate.strategy.push_back({Kind::residuals, present});
    } else if (value->is(JsonValue::Kind::array)) {
        read_stages(*value, job, estimate);
    } else if (value->refused()) {
        return;
    } else if (estimate.waveform) {
        value->report("\"auto\" knows no waveforms: list the stages, [\"waveform\"] for example");
    } else {
        estimate.strategy = identification::automatic_strategy(
            identification::StrategyData{has_readings(job, estimate), estimate.cycles.has_value(), is_searched(job),
                                         estimate.series.has_value(), false});
    }
    if (const auto scan = object.find("scan")) {
        estimate.scan = scan->boolean().value_or(false);
        const bool predicts = std::any_of(estimate.strategy.begin(), estimate.strategy.end(),
                                          [](const StageJob& stage) { return stage.kind == Kind::prediction; });
        if (estimate.scan && !predicts)
            scan->report("belongs to the stage \"prediction\", which is not in \"strategy\"");
    }
}

}  // namespace orbid::apps

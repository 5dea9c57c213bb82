#include <algorithm>

#include "apps/documents/json_text.hpp"
#include "apps/job/blocks/estimate_fields.hpp"
#include "apps/job/data_job.hpp"
#include "apps/job/orbits_job.hpp"

namespace orbid::apps::describe {

namespace {

using Json = nlohmann::ordered_json;
using Kind = StageJob::Kind;

/// Stages that stand beside those of residuals.
const std::vector<std::string> other_stages{"prediction", "harvest"};

/// In a record that later stages can read again. Of a job without data that is the mistake to tell, and no other.
bool is_searched(const Job& job) {
    return job.orbits && !job.orbits->file &&
           (job.orbits->data >= job.data.size() || !job.data[job.orbits->data].streamed());
}

bool is_read_by_formulas(const Job& job, const EstimateJob& estimate) {
    return estimate.series &&
           std::any_of(estimate.series->data.begin(), estimate.series->data.end(), [&](std::size_t index) {
               return job.data[index].sensor.type == models::Sensor::Type::function;
           });
}

/// A prediction starts from states that readings say.
bool has_readings(const Job& job, const EstimateJob& estimate) {
    if (is_read_by_formulas(job, estimate)) return false;
    return (estimate.series && !estimate.series->data.empty()) || is_searched(job);
}

bool has_stage(const EstimateJob& estimate, const auto& holds) {
    return std::any_of(estimate.strategy.begin(), estimate.strategy.end(), holds);
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

StageJob prediction_stage(const ValueReader& item, const Job& job, const EstimateJob& estimate) {
    if (!estimate.strategy.empty()) item.report("the prediction gives a start: it must be the first stage");
    if (is_read_by_formulas(job, estimate))
        item.report("a prediction begins at states that readings say: those by formulas say none");
    else if (!has_readings(job, estimate))
        item.report("needs a series: a residual of type series, or \"orbits\" that are searched for, not in a stream");
    return {Kind::prediction, {}};
}

StageJob harvest_stage(const ValueReader& item, const Job& job, const EstimateJob& estimate) {
    if (!is_searched(job)) item.report("needs \"orbits\" that are searched for in a series, which is no stream");
    if (!has_stage(estimate, [](const StageJob& one) { return one.uses(ResidualType::cycles); }))
        item.report("must come after \"cycles\": it looks for what their estimate points to");
    return {Kind::harvest, {ResidualType::cycles}};
}

std::vector<std::string> stage_names() {
    std::vector<std::string> stages = residual_type_names;
    stages.insert(stages.end(), other_stages.begin(), other_stages.end());
    return stages;
}

void read_list(const ValueReader& value, const Job& job, bool if_needed, std::vector<ResidualType>& used,
               EstimateJob& estimate);

/// { "if_needed": [ ... ] }: stages for where the series is not enough, it among them once more.
void read_needed_stages(const ValueReader& item, const Job& job, std::vector<ResidualType>& used,
                        EstimateJob& estimate) {
    ObjectReader object(item);
    const auto list = object.find("if_needed");
    object.finish();
    if (!list) return;
    if (!has_stage(estimate, [](const StageJob& one) { return one.is_series(); }))
        item.report("needs a stage \"series\" before it, which may be enough");
    std::vector<ResidualType> again = used;
    std::erase(again, ResidualType::series);
    read_list(*list, job, true, again, estimate);
    used.insert(used.end(), again.begin(), again.end());
}

void read_list(const ValueReader& value, const Job& job, bool if_needed, std::vector<ResidualType>& used,
               EstimateJob& estimate) {
    const auto present = estimate.residual_types();
    const std::vector<std::string> stages = stage_names();
    for (const ValueReader& item : value.items()) {
        StageJob stage;
        if (!estimate.strategy.empty() && estimate.strategy.back().if_needed && !if_needed)
            item.report("must not follow the stages that are run if needed");
        if (item.is(JsonValue::Kind::object)) {
            read_needed_stages(item, job, used, estimate);
            continue;
        }
        if (item.is(JsonValue::Kind::array)) {
            for (const ValueReader& inner : item.items())
                if (const auto choice = inner.choice(residual_type_names))
                    add_type(inner, *choice, present, used, stage);
            std::sort(stage.residuals.begin(), stage.residuals.end());
        } else {
            const auto choice = item.choice(stages);
            if (!choice) continue;
            if (*choice < residual_type_names.size()) {
                add_type(item, *choice, present, used, stage);
            } else {
                stage = stages[*choice] == "prediction" ? prediction_stage(item, job, estimate)
                                                        : harvest_stage(item, job, estimate);
            }
        }
        stage.if_needed = if_needed;
        estimate.strategy.push_back(std::move(stage));
    }
}

void read_stages(const ValueReader& value, const Job& job, EstimateJob& estimate) {
    std::vector<ResidualType> used;
    read_list(value, job, false, used, estimate);
    if (!value.sound()) return;
    for (const ResidualType type : estimate.residual_types()) {
        if (std::find(used.begin(), used.end(), type) != used.end()) continue;
        value.report(fmt::format("must name every type of \"residuals\": there is no \"{}\"",
                                 name_of(type, residual_type_names)));
    }
}

void read_strategy(const ValueReader& value, const Job& job, EstimateJob& estimate) {
    estimate.strategy.clear();
    // That residuals are missing is reported; that the stages lack them would only say so again.
    if (value.refused() || estimate.residual_types().empty()) return;
    if (value.is(JsonValue::Kind::array)) {
        read_stages(value, job, estimate);
    } else if (estimate.waveform || estimate.branch) {
        const auto present = estimate.residual_types();
        value.report(fmt::format("\"auto\" knows no {}: list the stages, [\"{}\"] for example",
                                 estimate.waveform ? "waveforms" : "branches",
                                 name_of(present.back(), residual_type_names)));
    } else {
        estimate.strategy = identification::automatic_strategy(identification::StrategyData{
            has_readings(job, estimate), estimate.cycles.has_value(), is_searched(job), estimate.series.has_value(),
            false, false, estimate.usual_residuals && is_searched(job)});
    }
}

void check_scan(const ValueReader& scan, const Job&, EstimateJob& estimate) {
    if (!estimate.scan || estimate.strategy.empty()) return;
    if (!has_stage(estimate, [](const StageJob& stage) { return stage.kind == Kind::prediction; }))
        scan.report("belongs to the stage \"prediction\", which is not in \"strategy\"");
}

Json stage_document(const StageJob& stage) {
    if (stage.kind != Kind::residuals || stage.residuals.size() == 1) return stage.name();
    return json_list(stage.residuals, [](ResidualType type) { return name_of(type, residual_type_names); });
}

Json strategy_document(const EstimateJob& estimate, const Writing&) {
    Json stages = Json::array(), needed = Json::array();
    for (const StageJob& stage : estimate.strategy)
        (stage.if_needed ? needed : stages).push_back(stage_document(stage));
    if (!needed.empty()) stages.push_back({{"if_needed", needed}});
    return stages;
}

}  // namespace

void add_strategy_fields(FieldTable<EstimateJob>& table) {
    const ValueSchema stage = choice(stage_names()) | set(choice(residual_type_names), 1);
    const ValueSchema needed =
        object({key("if_needed", list(stage, 1), "Stages that are left out where the series before them is explained.")
                    .required_always()});
    table.push_back(
        {key("strategy", choice({"auto"}) | list(stage | needed, 1),
             "Stages, each from the best before it; what stands in a list within the list is estimated from together."),
         read_strategy, strategy_document});
    table.push_back(
        field(key("scan", boolean(), "The prediction begins with a coarse scan of the parameters over their bounds."),
              &EstimateJob::scan)
            .with_rule(check_scan)
            .written_if([](const EstimateJob& estimate) { return estimate.scan; }));
}

}  // namespace orbid::apps::describe

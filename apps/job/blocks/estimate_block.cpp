#include <algorithm>

#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/estimate_fields.hpp"
#include "apps/job/data_job.hpp"

namespace orbid::apps {

namespace describe {

namespace {

using Json = nlohmann::ordered_json;

void read_derived(const ValueReader& value, const Job& job, EstimateJob& estimate) {
    const std::vector<std::string> parameters = parameter_names(job);
    for (const auto& [name, member] : value.members()) {
        const auto formula = member.text();
        if (!is_name(name, member) || !formula) continue;
        if (is_in(name, parameters)) member.report(fmt::format("\"{}\" is a parameter of the model already", name));
        if (!job.model.system) continue;
        try {
            estimate.derived.push_back({name, models::Expression::parse(*formula, parameters)});
        } catch (const models::ExpressionError& error) {
            member.report_character(error.position, error.what());
            // Named all the same, so that its reference value is not called unknown.
            estimate.derived.push_back({name, {}});
        }
    }
}

Field<EstimateJob> derived_field() {
    return {key("derived", entries(text(), "a derived quantity"),
                "Formulas of parameters whose values and intervals are shown: { \"k_over_m\": \"k / m\" }.")
                .standard_text("{}"),
            read_derived, [](const EstimateJob& estimate, const Writing&) {
                Json object = Json::object();
                for (const DerivedJob& derived : estimate.derived)
                    object[derived.name] = derived.expression.text();
                return object;
            }};
}

}  // namespace

const FieldTable<EstimateJob>& estimate_fields() {
    static const FieldTable<EstimateJob> table = [] {
        FieldTable<EstimateJob> fields{
            parameters_field(), joint_priors_field().written_after("derived"), derived_field(), residuals_field(),
            choice_field(
                key("variance", {},
                    "How error scales are estimated: maximum likelihood, restricted likelihood, or integrated out."),
                variance_names, &EstimateJob::variance)};
        add_strategy_fields(fields);
        add_posterior_fields(fields);
        fields.push_back(criticism_field().written_after("scan"));
        return fields;
    }();
    return table;
}

}  // namespace describe

void read_estimate(ObjectReader& root, Job& job) {
    const auto value = root.find("estimate");
    if (!value) {
        for (const DataJob& data : job.data)
            if (!data.free.empty()) root.self().report(fmt::format("\"free\" in \"{}\" needs \"estimate\"", data.name));
        return;
    }
    EstimateJob estimate;
    estimate.multi_start.seed = job.seed;
    ObjectReader object(*value);
    const auto strategy = object.find("strategy");
    estimate.automatic = strategy && strategy->is(JsonValue::Kind::string) && strategy->value().text == "auto";
    if (!object.find("residuals")) {
        if (estimate.automatic) {
            describe::add_usual_residuals(*strategy, job, estimate);
        } else {
            (void)object.require("residuals",
                                 "[ { \"type\": \"cycles\" } ], for example; with \"strategy\": \"auto\" not needed");
        }
    }
    read_fields(object, describe::estimate_fields(), estimate, job);
    object.finish();
    job.estimate = std::move(estimate);
}

}  // namespace orbid::apps

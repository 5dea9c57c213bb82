#include <algorithm>

#include "apps/job/blocks/estimate_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "models/catalogue/registry.hpp"

namespace orbid::apps::describe {

namespace {

using Json = nlohmann::ordered_json;

std::vector<std::string> variants_of(const std::string& model) {
    for (const models::ModelEntry& entry : models::registered_models())
        if (entry.name == model) return {entry.variants.begin(), entry.variants.end()};
    return {};
}

void read_variants(const ValueReader& value, const Job& job, EstimateJob& estimate) {
    if (!job.model.system) return;
    const auto known = variants_of(job.model.name);
    if (known.size() < 2) {
        value.report(fmt::format("the model {} has no other variants", job.model.name));
        return;
    }
    auto& variants = estimate.criticism.variants;
    for (const ValueReader& item : value.items()) {
        const auto choice = item.choice(known);
        if (!choice) continue;
        const std::string& name = known[*choice];
        // The job's own stands for itself: a list of all variants compares it with the others.
        if (is_in(name, variants) || name == job.model.variant) continue;
        Job other;
        other.model.system = models::make_system(job.model.name, name, job.model.size);
        if (parameter_names(other) != parameter_names(job) || coordinate_names(other) != coordinate_names(job))
            item.report(fmt::format("\"{}\" has other parameters or coordinates than \"{}\"", name, job.model.variant));
        variants.push_back(name);
    }
    if (variants.empty() && value.is(JsonValue::Kind::array) && value.value().items.size() == 1 &&
        value.value().items.front().text == job.model.variant)
        value.report(fmt::format("\"{}\" is the job's own variant: name another one", job.model.variant));
}

/// Why a parameter cannot be left out; empty when it can.
std::string why_needed(const FreeParameterJob& free, const Job& job, const EstimateJob& estimate) {
    const std::string& name = free.value.name;
    const models::Parameter& entry = job.model.parameter(free.parameter);
    if (!models::contains(entry.domain, 0.0))
        return fmt::format("{} ({}) must be {}: there is no model without it", name, entry.description,
                           models::rule(entry.domain));
    const auto tied = [&](const std::string& other) {
        return fmt::format("{} is tied to {}: it cannot be left out alone", name, other);
    };
    for (const FreeParameterJob& other : estimate.parameters)
        if (other.value.tied_to == name) return tied(other.value.name);
    if (!free.value.tied_to.empty()) return tied(free.value.tied_to);
    for (const estimator::JointNormalPrior& joint : estimate.joint_priors)
        if (is_in(name, joint.names))
            return fmt::format("{} has a prior together with others: it cannot be left out alone", name);
    return "";
}

void read_without(const ValueReader& value, const Job& job, EstimateJob& estimate) {
    std::vector<std::string> estimated;
    for (const FreeParameterJob& free : estimate.parameters)
        estimated.push_back(free.value.name);
    for (const auto& [text, item] : read_names(value)) {
        const auto at = std::find(estimated.begin(), estimated.end(), text);
        if (at == estimated.end()) {
            item.report(fmt::format("\"{}\" is not estimated{}", text, suggestion(text, estimated)));
            continue;
        }
        const FreeParameterJob& free = estimate.parameters[static_cast<std::size_t>(at - estimated.begin())];
        if (const std::string why = why_needed(free, job, estimate); !why.empty()) {
            item.report(why);
        } else {
            estimate.criticism.without.push_back(free.parameter);
        }
    }
}

const FieldTable<EstimateJob>& criticism_fields() {
    static const FieldTable<EstimateJob> table{
        Field<EstimateJob>{
            key("variants", names(), "Variants of the model to compare with.").standard_text("[]"), read_variants,
            [](const EstimateJob& estimate, const Writing&) -> Json { return estimate.criticism.variants; }}
            // An empty list names nothing, and a model that has no variants refuses the key.
            .written_if([](const EstimateJob& estimate) { return !estimate.criticism.variants.empty(); }),
        {key("without", names(), "Parameters held at 0, one at a time.").standard_text("[]"), read_without,
         [](const EstimateJob& estimate, const Writing& at) {
             return parameter_list(at.job, estimate.criticism.without);
         }},
        field(key("held_out", from_to(0.0, 0.5), "Share of the data that is left out in turn and predicted."),
              &EstimateJob::criticism, &CriticismJob::held_out)};
    return table;
}

}  // namespace

Field<EstimateJob> criticism_field() {
    return {key("criticism", object(keys_of(criticism_fields())), "Other models that the estimate is compared with."),
            [](const ValueReader& value, const Job& job, EstimateJob& estimate) {
                const std::size_t problems_before = value.problem_count();
                read_object(value, criticism_fields(), estimate, job);
                if (value.sound() && !estimate.criticism.any() && value.problem_count() == problems_before)
                    value.report(
                        "names nothing to compare: \"variants\" of the model, parameters \"without\" which it is "
                        "tried, or a share \"held_out\"");
            },
            [](const EstimateJob& estimate, const Writing& at) {
                return estimate.criticism.any() ? fields_document(estimate, criticism_fields(), at) : left_out();
            }};
}

}  // namespace orbid::apps::describe

#include <algorithm>

#include "apps/job/estimate_job.hpp"
#include "apps/job/job_parts.hpp"
#include "models/catalogue/registry.hpp"

namespace orbid::apps {

namespace {

std::vector<std::string> variants_of(const std::string& model) {
    for (const models::ModelEntry& entry : models::registered_models())
        if (entry.name == model) return {entry.variants.begin(), entry.variants.end()};
    return {};
}

void read_variants(const ValueReader& value, const Job& job, CriticismJob& criticism) {
    if (!job.model.system) return;
    const auto known = variants_of(job.model.name);
    if (known.size() < 2) {
        value.report(fmt::format("the model {} has no other variants", job.model.name));
        return;
    }
    for (const ValueReader& item : value.items()) {
        const auto choice = item.choice(known);
        if (!choice) continue;
        const std::string& name = known[*choice];
        const auto& list = criticism.variants;
        if (std::find(list.begin(), list.end(), name) == list.end() && name != job.model.variant) {
            // The job's own stands for itself: a list of all variants compares it with the others.
            Job other;
            other.model.system = models::make_system(job.model.name, name, job.model.size);
            if (parameter_names(other) != parameter_names(job) || coordinate_names(other) != coordinate_names(job))
                item.report(
                    fmt::format("\"{}\" has other parameters or coordinates than \"{}\"", name, job.model.variant));
            criticism.variants.push_back(name);
        }
    }
    if (criticism.variants.empty() && value.is(JsonValue::Kind::array) && value.value().items.size() == 1 &&
        value.value().items.front().text == job.model.variant)
        value.report(fmt::format("\"{}\" is the job's own variant: name another one", job.model.variant));
}

void read_without(const ValueReader& value, const Job& job, const EstimateJob& estimate, CriticismJob& criticism) {
    std::vector<std::string> estimated;
    for (const FreeParameterJob& free : estimate.parameters)
        estimated.push_back(free.value.name);
    for (const auto& [text, item] : read_names(value)) {
        const std::string& name = text;
        const auto free = std::find_if(estimate.parameters.begin(), estimate.parameters.end(),
                                       [&](const FreeParameterJob& one) { return one.value.name == name; });
        if (free == estimate.parameters.end()) {
            item.report(fmt::format("\"{}\" is not estimated{}", name, suggestion(name, estimated)));
            continue;
        }
        const models::Parameter& entry = job.model.parameter(free->parameter);
        if (!models::contains(entry.domain, 0.0)) {
            item.report(fmt::format("{} ({}) must be {}: there is no model without it", name, entry.description,
                                    models::rule(entry.domain)));
            continue;
        }
        const auto follower = std::find_if(estimate.parameters.begin(), estimate.parameters.end(),
                                           [&](const FreeParameterJob& one) { return one.value.tied_to == name; });
        if (!free->value.tied_to.empty() || follower != estimate.parameters.end()) {
            item.report(fmt::format("{} is tied to {}: it cannot be left out alone", name,
                                    free->value.tied_to.empty() ? follower->value.name : free->value.tied_to));
            continue;
        }
        const auto& joint = estimate.joint_priors;
        if (std::any_of(joint.begin(), joint.end(), [&](const estimator::JointNormalPrior& prior) {
                return std::count(prior.names.begin(), prior.names.end(), name) > 0;
            })) {
            item.report(fmt::format("{} has a prior together with others: it cannot be left out alone", name));
            continue;
        }
        criticism.without.push_back(free->parameter);
    }
}

}  // namespace

void read_criticism(ObjectReader& object, const Job& job, EstimateJob& estimate) {
    const auto value = object.find("criticism");
    if (!value) return;
    const std::size_t problems_before = value->problem_count();
    CriticismJob criticism;
    ObjectReader inner(*value);
    if (const auto variants = inner.find("variants")) read_variants(*variants, job, criticism);
    if (const auto without = inner.find("without")) read_without(*without, job, estimate, criticism);
    inner.read("held_out", criticism.held_out);
    inner.finish();
    if (value->sound() && !criticism.any() && value->problem_count() == problems_before)
        value->report(
            "names nothing to compare: \"variants\" of the model, parameters \"without\" which it is tried, or a share "
            "\"held_out\"");
    estimate.criticism = std::move(criticism);
}

}  // namespace orbid::apps

#include "apps/program/command_schema.hpp"

#include <ostream>

#include <fmt/format.h>

#include "apps/campaign/plan/campaign_file.hpp"
#include "apps/documents/json_schema.hpp"
#include "apps/documents/schema_page.hpp"
#include "apps/job/blocks/job_schema.hpp"

#include "models/catalogue/registry.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;

Json parameter_schema(const models::Parameter& parameter) {
    Json written{{"type", "number"}};
    if (parameter.domain == models::Domain::positive) written["exclusiveMinimum"] = 0;
    if (parameter.domain == models::Domain::nonnegative) written["minimum"] = 0;
    written["description"] = fmt::format("[{}] {}", parameter.unit, parameter.description);
    written["default"] = parameter.default_value;
    return written;
}

/// What the block "model" may hold beside the name of a registered model: its variants, size, and the parameters of
/// any of its variants.
Json model_rule(const models::ModelEntry& entry) {
    Json parameters{{"from", true}};  // described with the block
    std::vector<std::string_view> variants = entry.variants;
    if (variants.empty()) variants.emplace_back();
    for (const std::string_view variant : variants) {
        const auto system = models::make_system(entry.name, variant);
        for (const models::Parameter& parameter : system->parameters())
            parameters[std::string(parameter.name)] = parameter_schema(parameter);
    }
    // "" means the first one.
    if (!entry.variants.empty()) variants.emplace_back();
    Json properties{{"variant", {{"enum", variants}}},
                    {"parameters", {{"properties", std::move(parameters)}, {"additionalProperties", false}}}};
    properties["size"] = entry.size ? Json{{"minimum", entry.size->smallest}} : Json(false);
    return {{"if", {{"properties", {{"name", {{"const", entry.name}}}}}, {"required", {"name"}}}},
            {"then", {{"description", entry.summary}, {"properties", std::move(properties)}}}};
}

/// Names of models and of their parameters: what the reader compares with the registry.
void add_models(Json& model) {
    Json names = Json::array();
    Json rules = Json::array();
    for (const models::ModelEntry& entry : models::registered_models()) {
        names.push_back(entry.name);
        rules.push_back(model_rule(entry));
    }
    const Json registered{{"properties", {{"name", {{"enum", names}}}}}, {"allOf", std::move(rules)}};
    const Json own{{"properties", {{"name", {{"not", {{"enum", names}}}}}}}};
    model["allOf"].push_back({{"if", {{"required", {"equations"}}}}, {"then", own}, {"else", registered}});
}

}  // namespace

std::string job_schema_text() {
    Json document = json_schema(job_description());
    document["title"] = "a job of orbid";
    add_models(document["properties"]["model"]);
    return document.dump(2) + "\n";
}

std::string job_reference_text() {
    return reference_page(
        job_description(), "All keys of a job",
        "What a job may hold; written by `orbid schema --markdown` from the descriptions that jobs are read by.\n"
        "How editors are told of them: [jobs.md](jobs.md). A value of a list is shown as `[]`, of an object whose\n"
        "keys are names as `NAME`.");
}

std::string campaign_schema_text() {
    Json document = json_schema(campaign_description());
    document["title"] = "a campaign of orbid";
    return document.dump(2) + "\n";
}

std::string campaign_reference_text() {
    return reference_page(
        campaign_description(), "All keys of a campaign",
        "What a campaign may hold; written by `orbid schema --campaign --markdown` from the descriptions that\n"
        "campaigns are read by. What they do: [campaigns.md](campaigns.md). A value of a list is shown as `[]`, of an\n"
        "object whose keys are names as `NAME`.");
}

int show_schema(const CommandCall& call) {
    const bool page = call.has("markdown");
    if (call.has("campaign"))
        call.console.out << (page ? campaign_reference_text() : campaign_schema_text());
    else
        call.console.out << (page ? job_reference_text() : job_schema_text());
    return 0;
}

}  // namespace orbid::apps

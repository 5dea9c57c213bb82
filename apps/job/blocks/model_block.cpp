#include "apps/job/blocks/model_block.hpp"

#include "apps/documents/atomic_file.hpp"
#include "apps/documents/json_value.hpp"
#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"

namespace orbid::apps {

namespace describe {

namespace {

/// What is read when it is known which model it is.
void read_with_model(const ValueReader&, const Job&, ModelBlock&) {}

nlohmann::ordered_json parameters_document(const ModelBlock& block, const Writing& at) {
    auto parameters = nlohmann::ordered_json::object();
    for (Eigen::Index i = 0; i < block.model.values.size(); ++i) {
        const double value = block.model.values[i];
        parameters[parameter_name(at.job, i)] =
            block.model.equations
                ? equation_parameter_document(block.text.parameters[static_cast<std::size_t>(i)], value)
                : nlohmann::ordered_json(value);
    }
    return parameters;
}

}  // namespace

const models::ModelEntry* registered(const std::string& name) {
    for (const models::ModelEntry& entry : models::registered_models())
        if (entry.name == name) return &entry;
    return nullptr;
}

const FieldTable<ModelBlock>& model_fields() {
    static const FieldTable<ModelBlock> table = [] {
        FieldTable<ModelBlock> fields{
            {key("name", name(),
                 "One of the models that `orbid models` lists; beside \"equations\" a name of their own.")
                 .needed_unless("equations"),
             read_with_model,
             [](const ModelBlock& block, const Writing&) -> nlohmann::ordered_json { return block.model.name; }},
            {key("variant", text(), "Of the model; the first that `orbid models NAME` lists unless given.")
                 .without("equations"),
             read_with_model,
             [](const ModelBlock& block, const Writing&) -> nlohmann::ordered_json {
                 if (block.model.equations) return left_out();
                 return block.model.variant;
             }},
            {key("size", whole(1, models::ModelSize::largest), "Number of coordinates, of a model that leaves it open.")
                 .without("equations"),
             read_with_model,
             [](const ModelBlock& block, const Writing&) -> nlohmann::ordered_json {
                 if (!block.model.size) return left_out();
                 return *block.model.size;
             }},
            // A number; of equations in the job also with what else is known of the parameter.
            Field<ModelBlock>{
                key("parameters",
                    entries(number() | object(keys_of(equation_parameter_fields())), "a parameter",
                            {key("from", file_name(),
                                 "A result.json: the values of that run, for all parameters that this one shares.")}),
                    "Data are simulated at these values, and fixed parameters keep them; those left out have the "
                    "defaults of the model.")
                    .needed_with("equations"),
                read_with_model, parameters_document}
                .written_after("units")};
        const FieldTable<ModelBlock> equations = equations_fields();
        fields.insert(fields.end(), equations.begin(), equations.end());
        return fields;
    }();
    return table;
}

}  // namespace describe

namespace {

void resolve_model(const ValueReader& name_value, const std::optional<ValueReader>& variant_value,
                   const std::optional<ValueReader>& size_value, Job& job) {
    const auto name = name_value.text();
    if (!name) return;
    const models::ModelEntry* entry = describe::registered(*name);
    if (entry == nullptr) {
        std::vector<std::string> known;
        for (const models::ModelEntry& each : models::registered_models())
            known.emplace_back(each.name);
        name_value.report(fmt::format("there is no model \"{}\"{}", *name, suggestion(*name, known)));
        return;
    }
    std::string variant;
    if (variant_value) {
        const std::vector<std::string> known(entry->variants.begin(), entry->variants.end());
        if (known.empty()) {
            // job.json writes "" for a model without variants.
            if (!variant_value->value().text.empty())
                variant_value->report(fmt::format("the model {} has no variants", *name));
        } else if (!variant_value->value().text.empty()) {
            // "" is the default: a job.json written before the model had variants says so.
            const auto choice = variant_value->choice(known);
            if (!choice) return;
            variant = known[*choice];
        }
    }
    std::optional<std::size_t> size;
    if (entry->size) size = entry->size->standard;
    if (size_value && !entry->size) {
        size_value->report(
            fmt::format("the number of coordinates of {} is part of its equations: leave \"size\" out", *name));
    } else if (size_value) {
        const auto chosen = size_value->whole(entry->size->smallest, models::ModelSize::largest);
        // A bad size is reported; with the standard one the rest of the job can be checked too.
        if (chosen) size = static_cast<std::size_t>(*chosen);
    }
    job.model.name = *name;
    job.model.size = size;
    job.model.system = models::make_system(*name, variant, size);
    job.model.variant = job.model.system->variant();
    job.model.values = job.model.system->default_parameters();
}

/// The parameters that the run of a result.json shares with this model: its estimates, and what its job had fixed.
/// Those of single experiments are left out.
nlohmann::json values_of_run(const ValueReader& from, const Job& job) {
    using Json = nlohmann::json;
    Json values = Json::object();
    const auto file = read_path(from, job);
    if (!file || !std::filesystem::is_regular_file(*file)) return values;
    const auto take = [&](const std::filesystem::path& path, const char* format, const Json::json_pointer& place) {
        Json document = json_value_or_discarded(read_whole_file(path));
        const bool known = document.is_object() && document.value("format", Json()) == format;
        if (!known) from.report_data(fmt::format("\"{}\" is no file of the format {}", path.string(), format));
        if (!known || !document.contains(place)) return known;
        for (const auto& [name, value] : document[place].items())
            values[name] = value.is_object() ? value.value("value", Json()) : value;
        return true;
    };
    const auto beside = file->parent_path() / "job.json";
    if (std::filesystem::exists(beside) && !take(beside, "orbid-job/1", "/model/parameters"_json_pointer)) return {};
    if (!take(*file, "orbid-result/1", "/parameters"_json_pointer)) return {};
    std::erase_if(values.get_ref<Json::object_t&>(), [&job](const auto& entry) {
        return job.model.system->parameter_index(entry.first) < 0 || !entry.second.is_number();
    });
    if (values.empty())
        from.report_data(fmt::format("\"{}\" has no parameter of the model {}", file->string(), job.model.name));
    return values;
}

void take_values_of_run(const ValueReader& parameters, Job& job) {
    if (!job.model.system) return;
    for (const auto& [key, from] : parameters.members()) {
        if (key != "from") continue;
        const nlohmann::json values = values_of_run(from, job);
        for (const auto& [name, value] : values.items())
            job.model.values[job.model.system->parameter_index(name)] = value.get<double>();
    }
}

void take_own_values(const ValueReader& parameters, Job& job) {
    for (const auto& [name, member] : parameters.members()) {
        if (name == "from") continue;
        const auto index = parameter_named(name, member, job);
        if (!index) continue;
        if (const auto number = read_parameter_value(member, *index, job)) job.model.values[*index] = *number;
    }
}

}  // namespace

void read_model(ObjectReader& root, Job& job) {
    const auto value = root.find("model");
    if (!value) return;
    const std::size_t before = value->problem_count();
    ObjectReader object(*value);
    describe::ModelBlock block;
    read_fields(object, describe::model_fields(), block, job);
    const auto name = object.find("name");
    const auto parameters = object.find("parameters");
    if (const auto equations = object.find("equations")) {
        describe::read_equation_names(name, parameters, block);
        if (const auto data = root.find("data")) block.text.used_outside = names_in_data(data->value());
        if (const auto estimate = root.find("estimate"))
            for (std::string& used : names_in_residuals(estimate->value()))
                block.text.used_outside.push_back(std::move(used));
        // What is no text, name or number cannot be understood further.
        if (value->sound() && value->problem_count() == before) describe::use_equations(*equations, block, job);
        if (parameters) take_values_of_run(*parameters, job);
    } else {
        if (name) resolve_model(*name, object.find("variant"), object.find("size"), job);
        if (parameters) take_values_of_run(*parameters, job);
        if (parameters) take_own_values(*parameters, job);
    }
    object.finish();
}

}  // namespace orbid::apps

#include <algorithm>

#include "apps/job/job_parts.hpp"
#include "models/catalogue/registry.hpp"

namespace orbid::apps {

namespace {

const models::ModelEntry* registered(const std::string& name) {
    for (const models::ModelEntry& entry : models::registered_models())
        if (entry.name == name) return &entry;
    return nullptr;
}

void resolve(const ValueReader& name_value, const std::optional<ValueReader>& variant_value,
             const std::optional<ValueReader>& size_value, Job& job) {
    const auto name = name_value.text();
    if (!name) return;
    const models::ModelEntry* entry = registered(*name);
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
        size_value->report(fmt::format("the number of coordinates of {} is part of its equations", *name));
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

/// { "coordinate": "z", "value": 27, "direction": -1 } of an autonomous flow.
void read_plane(ObjectReader& section, Job& job) {
    SectionPlaneJob plane;
    if (const auto coordinate =
            section.require("coordinate", "the coordinate that has the same value at all crossings")) {
        const auto name = coordinate->text();
        const auto index = name ? coordinate_named(*name, *coordinate, job) : std::nullopt;
        plane.coordinate = index.value_or(0);
        // The flow does not wrap an angle: it would cross a value once, and not at every turn.
        if (index && job.model.coordinate(*index).angle) coordinate->report_later("a section at an angle");
    }
    if (const auto value = section.require("value", "the value it is crossed at")) value->read(plane.value);
    section.read("direction", plane.direction);
    job.section_plane = plane;
}

}  // namespace

void read_model(ObjectReader& root, Job& job) {
    const auto value = root.find("model");
    if (!value) return;
    ObjectReader model(*value);
    if (model.find("equations")) {
        const auto data = root.find("data");
        return read_equations(model, data ? names_in_sensors(data->value()) : std::vector<std::string>(), job);
    }
    const auto name = model.find("name");
    const auto variant = model.find("variant");
    const auto size = model.find("size");
    if (name) resolve(*name, variant, size, job);
    if (const auto parameters = model.find("parameters")) {
        for (const ParameterValue& entry : read_parameter_values(*parameters, job))
            job.model.values[entry.parameter] = entry.value;
    }
    model.finish();
}

void read_reference(ObjectReader& root, Job& job) {
    const auto value = root.find("reference");
    if (!value) return;
    std::vector<std::string> known = parameter_names(job);
    if (job.estimate) {
        for (const DerivedJob& derived : job.estimate->derived)
            known.push_back(derived.name);
    }
    for (const DataJob& data : job.data) {
        for (const Eigen::Index parameter : data.free)
            known.push_back(parameter_names(job)[static_cast<std::size_t>(parameter)] + "@" + data.name);
    }
    for (const auto& [name, member] : value->members()) {
        const auto number = member.number();
        if (job.model.system && std::find(known.begin(), known.end(), name) == known.end()) {
            member.report(fmt::format("\"{}\" is neither a parameter of the model nor a derived quantity{}", name,
                                      suggestion(name, known)));
        } else if (number) {
            job.reference.push_back({name, *number});
        }
    }
}

void read_section(ObjectReader& root, Job& job) {
    const auto value = root.find("section");
    if (!value) return;
    ObjectReader section(*value);
    const auto phase = section.find("phase");
    const auto coordinate = section.find("coordinate");
    const auto forced_only = [&] {
        phase->report(fmt::format("the model {} is not forced: it has no phase", job.model.name));
    };
    if (!job.model.system) return;  // which keys there are depends on the model
    const models::Kind kind = job.model.system->kind();
    if (kind == models::Kind::map) {
        // Every iterate of a map is its section.
        if (phase) {
            forced_only();
        } else {
            value->report(fmt::format("the model {} is a map: its iterates are the section", job.model.name));
        }
        return;
    }
    if (kind == models::Kind::autonomous) {
        if (phase && !coordinate) {
            forced_only();
            job.section_plane.emplace();  // one problem is enough: not also that sections have no plane
            return;
        }
        if (!coordinate && !value->sound()) {
            job.section_plane.emplace();
            return;
        }
        if (phase) forced_only();
        read_plane(section, job);
    } else {
        if (coordinate) {
            coordinate->report_later("a section of a forced model by a coordinate");
            return;
        }
        if (phase) phase->read(job.section_phase);
    }
    section.finish();
}

}  // namespace orbid::apps

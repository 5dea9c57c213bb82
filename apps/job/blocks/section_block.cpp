#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/blocks/model_block.hpp"

namespace orbid::apps {

namespace describe {

namespace {

/// Of forced models.
const FieldTable<Job>& section_phase_fields() {
    static const FieldTable<Job> table{
        field(key("phase", number(), "Forced models: the phase omega t at which the state is read.").in("rad"),
              &Job::section_phase)};
    return table;
}

/// Of autonomous models.
const FieldTable<SectionPlaneJob>& section_plane_fields() {
    static const FieldTable<SectionPlaneJob> table{
        {key("coordinate", text(), "Autonomous models: the coordinate that has the same value at all crossings."),
         [](const ValueReader& value, const Job& job, SectionPlaneJob& plane) {
             const auto word = value.text();
             const auto index = word ? coordinate_named(*word, value, job) : std::nullopt;
             plane.coordinate = index.value_or(0);
             // The flow does not wrap an angle: it would cross a value once, and not at every turn.
             if (index && job.model.coordinate(*index).angle) value.report_later("a section at an angle");
         },
         [](const SectionPlaneJob& plane, const Writing& at) -> nlohmann::ordered_json {
             return coordinate_name(at.job, plane.coordinate);
         }},
        // Needed beside a coordinate: whether a section has one depends on the model.
        open_field(key("value", number(), "The value it is crossed at.").with("coordinate"), &SectionPlaneJob::value),
        field(key("direction", one_of({1.0, -1.0}), "Crossed while the coordinate rises (1) or falls (-1).")
                  .with("coordinate"),
              &SectionPlaneJob::direction)};
    return table;
}

}  // namespace

ValueSchema section_block() {
    std::vector<KeySchema> keys = keys_of(section_phase_fields());
    for (const KeySchema& one : keys_of(section_plane_fields()))
        keys.push_back(one);
    return choice({"auto"}) | object(std::move(keys));
}

nlohmann::ordered_json section_document(const Job& job) {
    if (job.section_from_data) return "auto";
    if (job.section_plane) return fields_document(*job.section_plane, section_plane_fields(), {job});
    if (job.model.is(models::Kind::forced)) return fields_document(job, section_phase_fields(), {job});
    return left_out();
}

}  // namespace describe

namespace {

/// { "coordinate": "z", "value": 27, "direction": -1 } of an autonomous flow.
void read_plane(ObjectReader& section, Job& job) {
    SectionPlaneJob plane;
    for (const auto& [name, meaning] :
         {std::pair{"coordinate", "the coordinate that has the same value at all crossings"},
          std::pair{"value", "the value it is crossed at"}})
        (void)section.require(name, meaning);
    read_fields(section, describe::section_plane_fields(), plane, job);
    job.section_plane = plane;
}

}  // namespace

void read_section(ObjectReader& root, Job& job) {
    const auto value = root.find("section");
    if (!value) return;
    if (value->is(JsonValue::Kind::string)) {
        (void)value->choice({"auto"});
        if (job.model.system && !job.model.is(models::Kind::autonomous))
            value->report(fmt::format("the model {} is not autonomous: no plane is chosen for it", job.model.name));
        job.section_from_data = true;
        return;
    }
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
        read_fields(section, describe::section_phase_fields(), job, job);
    }
    section.finish();
}

}  // namespace orbid::apps

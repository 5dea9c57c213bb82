#include "apps/job/job_parts.hpp"

namespace orbid::apps {

namespace {

/// { "coordinate": "z", "value": 27, "direction": -1 } of an autonomous flow.
void read_plane(ObjectReader& section, Job& job) {
    SectionPlaneJob plane;
    if (const auto coordinate =
            section.require("coordinate", "the coordinate that has the same value at all crossings")) {
        const auto name = coordinate->text();
        const auto index = name ? coordinate_named(*name, *coordinate, job) : std::nullopt;
        plane.coordinate = index.value_or(0);
        // The flow does not wrap an angle: it would cross a value once, and not at every turn.
        if (index && job.model.system->coordinates()[static_cast<std::size_t>(*index)].angle)
            coordinate->report_later("a section at an angle");
    }
    if (const auto value = section.require("value", "the value it is crossed at"))
        plane.value = value->number().value_or(0.0);
    if (const auto direction = section.find("direction")) plane.direction = direction->number() == -1.0 ? -1 : 1;
    job.section_plane = plane;
}

}  // namespace

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
        if (phase) job.section_phase = phase->number().value_or(0.0);
    }
    section.finish();
}

}  // namespace orbid::apps

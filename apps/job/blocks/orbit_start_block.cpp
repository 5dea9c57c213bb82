#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/periodic_job.hpp"

namespace orbid::apps::describe {

namespace {

using Json = nlohmann::ordered_json;

std::vector<int> read_rotation(const ValueReader& value, const Job& job) {
    std::size_t angles = 0;
    if (job.model.system) {
        for (const models::Coordinate& coordinate : job.model.system->coordinates())
            angles += coordinate.angle ? 1 : 0;
    }
    const auto turns = [](const ValueReader& item) { return static_cast<int>(item.number().value_or(0.0)); };
    std::vector<int> rotation;
    if (value.is(JsonValue::Kind::number)) {
        rotation.push_back(turns(value));
    } else if (value.is(JsonValue::Kind::array)) {
        for (const ValueReader& item : value.items())
            rotation.push_back(turns(item));
    } else {
        return {};
    }
    if (job.model.system && rotation.size() != angles)
        value.report(fmt::format("must hold one number per angle of the model: {}, not {}", angles, rotation.size()));
    return rotation;
}

/// Where the motion begins and how it is cut into periods.
enum class StartKind { section, free_mesh, unknown };

/// The rules of period and time; an autonomous model without a section has orbits that begin anywhere.
StartKind check_length(ObjectReader& object, const Job& job, OrbitStart& start) {
    const bool free_mesh = job.model.is(models::Kind::autonomous) && !job.section_plane;
    const auto time = object.find("time");
    const auto period = object.find("period");
    if (free_mesh && !time) {
        start.period = 1;
        if (object.valid())
            object.self().report(
                fmt::format("the model {} is autonomous: needs a \"section\" in the job that its orbits cross, or the "
                            "\"time\" of the orbit in s, about, beside one point",
                            job.model.name));
        return StartKind::unknown;
    }
    if (!free_mesh) start.time = 0.0;
    if (time && !free_mesh && job.model.system)
        time->report(job.model.is(models::Kind::autonomous)
                         ? "follows from the crossings of the section: must be left out"
                         : "follows from \"period\": must be left out");
    if (period && free_mesh && start.period != 1) {
        period->report(fmt::format("counts crossings of a section, and the job has none: must be 1 or left out, not {}",
                                   start.period));
        return StartKind::unknown;
    }
    if (!period && object.valid() && !free_mesh) {
        object.self().report(
            "\"period\" is missing: in periods of the forcing, iterations, or crossings of the section");
        return StartKind::unknown;
    }
    return free_mesh ? StartKind::free_mesh : StartKind::section;
}

/// Crossings of a section lie on it.
void require_on_section(const ValueReader& point, const Eigen::VectorXd& state, const Job& job) {
    if (!job.section_plane || state(job.section_plane->coordinate) == job.section_plane->value) return;
    point.report(fmt::format("must lie on the section, where {} is {}",
                             job.model.coordinate(job.section_plane->coordinate).name, job.section_plane->value));
}

}  // namespace

const FieldTable<OrbitStart>& orbit_start_fields() {
    // More turns than this per orbit no pendulum makes; the limit keeps the number an int.
    constexpr double most_turns = 1e6;
    const ValueSchema turns = whole(-most_turns, most_turns);
    static const FieldTable<OrbitStart> table{
        open_field(key("period", whole(1, longest_computed_period),
                       "In periods of the forcing, iterations, or crossings of the section."),
                   &OrbitStart::period),
        {key("time", above(0.0), "Autonomous models without a section: length of the orbit, about.").in("s"),
         [](const ValueReader& value, const Job&, OrbitStart& start) { start.time = value.number().value_or(1.0); },
         [](const OrbitStart& start, const Writing&) { return start.time > 0.0 ? Json(start.time) : left_out(); }},
        {key("rotation", turns | list(turns), "Turns of each angle along the orbit; from the points unless given."),
         [](const ValueReader& value, const Job& job, OrbitStart& start) {
             start.rotation = read_rotation(value, job);
         },
         [](const OrbitStart& start, const Writing&) {
             return start.rotation.empty() ? left_out() : Json(start.rotation);
         }},
        // Read when it is known how many there must be.
        {key("points", list(state()), "One state per period: [[...], ...].").required_always(), read_later<OrbitStart>,
         [](const OrbitStart& start, const Writing&) { return columns_document(start.points); }}};
    return table;
}

OrbitStart read_orbit_start(const ValueReader& value, const Job& job) {
    OrbitStart start;
    ObjectReader object(value);
    read_fields(object, orbit_start_fields(), start, job);
    const StartKind kind = check_length(object, job, start);
    if (const auto points = object.find("points")) {
        const auto items = points->items();
        const auto period = static_cast<std::size_t>(start.period);
        if (points->is(JsonValue::Kind::array) && items.size() != period && kind != StartKind::unknown)
            points->report(kind == StartKind::free_mesh
                               ? fmt::format("must hold one state where there is no section, not {}", items.size())
                               : fmt::format("must hold one state per period: {}, not {}", start.period, items.size()));
        start.points = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(coordinate_names(job).size()), start.period);
        for (std::size_t j = 0; j < items.size(); ++j) {
            const auto point = read_state(items[j], job);
            if (point && j < period && point->size() == start.points.rows()) {
                start.points.col(static_cast<Eigen::Index>(j)) = *point;
                require_on_section(items[j], *point, job);
            }
        }
    }
    object.finish();
    return start;
}

}  // namespace orbid::apps::describe

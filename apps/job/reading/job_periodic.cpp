#include <limits>
#include <numeric>

#include "apps/job/job_parts.hpp"
#include "apps/job/schema/block_fields.hpp"

namespace orbid::apps {

namespace {

/// States from which the first trajectories begin.
void read_search_states(const ValueReader& value, const Job& job, periodic::OrbitSearchOptions& search) {
    const std::vector<Eigen::VectorXd> states = read_states(value, job);
    if (!job.model.system) return;
    search.initial.resize(job.model.system->dimension(), static_cast<Eigen::Index>(states.size()));
    for (std::size_t j = 0; j < states.size(); ++j)
        search.initial.col(static_cast<Eigen::Index>(j)) = states[j];
}

void read_orbit_search(const ValueReader& value, const Job& job, PeriodicJob& periodic) {
    periodic::OrbitSearchOptions& search = periodic.search.emplace();
    search.seed = job.seed;
    search.symmetry = job.model.system && job.model.system->symmetry().has_value();
    ObjectReader object(value);
    if (const auto periods = object.find("periods")) search.periods = read_periods(*periods).value_or(search.periods);
    object.read("points", search.points);
    object.read("trajectories", search.trajectories);
    if (const auto initial = object.find("initial")) read_search_states(*initial, job, search);
    object.read("patience", search.patience);
    object.read("seed", search.seed);
    object.read("stabilised", search.stabilised);
    const bool usable = search.symmetry;
    const auto symmetry = object.read("symmetry", search.symmetry);
    if (search.symmetry && !usable && job.model.system)
        symmetry->report(fmt::format("the model {} declares no symmetry; must be false", job.model.name));
    object.finish();
    if (job.model.is(models::Kind::autonomous) && !job.section_plane)
        value.report(
            fmt::format("the model {} is autonomous: needs a \"section\" in the job that its orbits cross: {{ "
                        "\"coordinate\": ..., \"value\": ..., \"direction\": ... }}",
                        job.model.name));
}

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

/// Crossings of a section lie on it.
void require_on_section(const ValueReader& point, const Eigen::VectorXd& state, const Job& job) {
    if (!job.section_plane || state(job.section_plane->coordinate) == job.section_plane->value) return;
    point.report(fmt::format("must lie on the section, where {} is {}",
                             job.model.coordinate(job.section_plane->coordinate).name, job.section_plane->value));
}

/// Finite differences and collocation follow a smooth solution in continuous time.
void require_smooth_flow(const ValueReader& method, const Job& job) {
    if (!job.model.system) return;
    const models::System& system = *job.model.system;
    if (system.kind() == models::Kind::map) {
        method.report(fmt::format("the model {} is a map: must be \"multiple_shooting\"", job.model.name));
        return;
    }
    // Values outside their domain are reported where they stand.
    for (std::size_t i = 0; i < system.parameters().size(); ++i)
        if (!models::contains(system.parameters()[i].domain, job.model.values[static_cast<Eigen::Index>(i)])) return;
    if (!system.smooth(job.model.values))
        method.report(fmt::format("the model {} is not smooth at these parameters: must be \"multiple_shooting\"",
                                  job.model.name));
}

periodic::OrbitMethod read_method(ObjectReader& object, const Job& job) {
    std::size_t choice = 0;
    if (const auto method = object.find("method")) {
        choice = method->choice(periodic_method_names).value_or(0);
        if (choice > 0) require_smooth_flow(*method, job);
    }
    periodic::ShootingOptions solver;
    // A start in a job is a guess, not a measurement: unless told otherwise, whatever orbit it leads to is shown, with
    // its distance.
    solver.maximum_distance = std::numeric_limits<double>::infinity();
    read_fields(object, describe::solver_fields(), solver);
    if (periodic_method_names[choice] == "finite_difference") {
        periodic::FiniteDifferenceOptions options;
        options.solver = solver;
        object.read("nodes", options.nodes);
        return options;
    }
    if (periodic_method_names[choice] == "collocation") {
        periodic::CollocationOptions options;
        options.solver = solver;
        object.read("accuracy", options.accuracy);
        if (const auto order = object.find("order")) {
            const auto number = order->whole();
            if (number && *number % 2 == 1) order->report(fmt::format("must be even, not {}", *number));
            if (number) options.stages = static_cast<int>(*number / 2);
        }
        object.read("intervals", options.intervals);
        return options;
    }
    object.read("accuracy", solver.flow.relative_tolerance);
    object.read("accuracy", solver.flow.absolute_tolerance);
    return solver;
}

/// Where the motion begins and how it is cut into periods.
enum class StartKind { section, free_mesh, unknown };

/// The period, and T of an autonomous model without a section, whose orbits begin anywhere.
StartKind read_period(ObjectReader& object, const Job& job, OrbitStart& start) {
    const bool free_mesh = job.model.is(models::Kind::autonomous) && !job.section_plane;
    const auto time = object.find("time");
    const auto period = object.find("period");
    if (free_mesh && !time) {
        if (object.valid())
            object.self().report(
                fmt::format("the model {} is autonomous: needs a \"section\" in the job that its orbits cross, or the "
                            "\"time\" of the orbit in s, about, beside one point",
                            job.model.name));
        return StartKind::unknown;
    }
    if (free_mesh) start.time = time->number().value_or(1.0);
    if (time && !free_mesh && job.model.system)
        time->report(job.model.is(models::Kind::autonomous)
                         ? "follows from the crossings of the section: must be left out"
                         : "follows from \"period\": must be left out");
    if (period) {
        start.period = static_cast<int>(period->whole().value_or(1));
        if (free_mesh && start.period != 1) {
            period->report(fmt::format(
                "counts crossings of a section, and the job has none: must be 1 or left out, not {}", start.period));
            return StartKind::unknown;
        }
    } else if (object.valid() && !free_mesh) {
        object.self().report(
            "\"period\" is missing: in periods of the forcing, iterations, or crossings of the section");
        return StartKind::unknown;
    }
    return free_mesh ? StartKind::free_mesh : StartKind::section;
}

OrbitStart read_start(const ValueReader& value, const Job& job) {
    OrbitStart start;
    ObjectReader object(value);
    const StartKind kind = read_period(object, job, start);
    if (const auto rotation = object.find("rotation")) start.rotation = read_rotation(*rotation, job);
    if (const auto points = object.find("points")) {
        const auto items = points->items();
        const auto period = static_cast<std::size_t>(start.period);
        if (points->is(JsonValue::Kind::array) && items.size() != period && kind != StartKind::unknown)
            points->report(kind == StartKind::free_mesh
                               ? fmt::format("must hold one state where there is no section, not {}", items.size())
                               : fmt::format("must hold one state per period: {}, not {}", start.period, items.size()));
        start.points = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(coordinate_names(job).size()), start.period);
        for (std::size_t j = 0; j < items.size(); ++j) {
            const auto state = read_state(items[j], job);
            if (state && j < period && state->size() == start.points.rows()) {
                start.points.col(static_cast<Eigen::Index>(j)) = *state;
                require_on_section(items[j], *state, job);
            }
        }
    }
    object.finish();
    return start;
}

/// Parameters by name; without the key all of them.
std::vector<Eigen::Index> read_free_indices(ObjectReader& object, const Job& job) {
    std::vector<Eigen::Index> indices;
    if (const auto value = object.find("free")) {
        for (const auto& [name, item] : read_names(*value))
            if (const auto index = parameter_named(name, item, job)) indices.push_back(*index);
        return indices;
    }
    indices.resize(parameter_names(job).size());
    std::iota(indices.begin(), indices.end(), Eigen::Index{0});
    return indices;
}

}  // namespace

void read_periodic(ObjectReader& root, Job& job) {
    const auto value = root.find("periodic");
    if (!value) return;
    PeriodicJob periodic;
    ObjectReader object(*value);
    if (job.model.system && !job.model.system->inputs().empty())
        value->report(fmt::format("the model {} is driven by measured inputs: it has no periodic orbits of its own",
                                  job.model.name));
    periodic.method = read_method(object, job);
    periodic.free = read_free_indices(object, job);
    // Its derivatives hold along the model's own orbit, which the others only approximate.
    const auto stability = object.read("stability", periodic.stability);
    if (periodic.stability && periodic.method.index() > 0)
        stability->report("needs \"method\": \"multiple_shooting\"; must be false with the others");
    if (const auto orbits = object.find("orbits")) {
        for (const ValueReader& item : orbits->items())
            periodic.orbits.push_back(read_start(item, job));
    }
    const auto search = object.find("search");
    if (search) read_orbit_search(*search, job, periodic);
    const auto continuation = object.find("continuation");
    if (continuation) read_continuation(*continuation, job, periodic);
    if (object.valid() && !object.find("orbits") && !search)
        object.self().report(
            continuation ? "a branch needs the orbit that it starts at: \"orbits\": [ { \"period\": ..., \"points\": "
                           "[[...], ...] } ], or \"search\": { \"periods\": [...] }"
                         : "needs \"orbits\", a list of starts { \"period\": ..., \"points\": [[...], ...] }, or "
                           "\"search\": { \"periods\": [...] }");
    object.finish();
    job.periodic = std::move(periodic);
}

}  // namespace orbid::apps

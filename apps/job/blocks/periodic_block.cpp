#include <cmath>
#include <limits>
#include <numeric>

#include "apps/documents/json_text.hpp"
#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"

namespace orbid::apps {

namespace describe {

namespace {

using Json = nlohmann::ordered_json;

// Enough for any orbit this program can hold; the limits keep the numbers ints.
constexpr double most_nodes = 1e6;
// Gauss points per interval that CollocationOptions allows, twice.
constexpr double highest_order = 20;
// Only guards the conversion to int.
constexpr double most_iterations = 1e4;

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

/// What all ways to solve for an orbit share.
template <class Periodic>
auto& solver_of(Periodic& periodic) {
    return std::visit(
        [](auto& options) -> auto& {
            if constexpr (requires { options.solver; }) {
                return options.solver;
            } else {
                return options;
            }
        },
        periodic.method);
}

const FieldTable<periodic::ShootingOptions>& solver_fields() {
    using Solver = periodic::ShootingOptions;
    static const FieldTable<Solver> table{
        field(key("tolerance", above(0.0), "Of the closing error, relative to the scales."), &Solver::tolerance),
        field(key("maximum_iterations", whole(1, most_iterations), "Newton steps."), &Solver::maximum_iterations),
        {key("maximum_distance", above(0.0),
             "An orbit farther from its start than this, relative to the scales, counts as another one; any unless "
             "given."),
         [](const ValueReader& value, const Job&, Solver& solver) { value.read(solver.maximum_distance); },
         [](const Solver& solver, const Writing&) {
             return std::isfinite(solver.maximum_distance) ? Json(solver.maximum_distance) : left_out();
         }}};
    return table;
}

void read_periodic_method(const ValueReader& value, const Job& job, PeriodicJob& periodic) {
    const auto choice = value.choice(periodic_method_names).value_or(0);
    if (choice > 0) require_smooth_flow(value, job);
    const periodic::ShootingOptions solver = solver_of(periodic);
    if (choice == 1) periodic.method = periodic::FiniteDifferenceOptions{};
    if (choice == 2) periodic.method = periodic::CollocationOptions{};
    solver_of(periodic) = solver;
}

void read_accuracy(const ValueReader& value, const Job&, PeriodicJob& periodic) {
    if (auto* shooting = std::get_if<periodic::ShootingOptions>(&periodic.method)) {
        value.read(shooting->flow.relative_tolerance);
        value.read(shooting->flow.absolute_tolerance);
    }
    if (auto* collocation = std::get_if<periodic::CollocationOptions>(&periodic.method))
        value.read(collocation->accuracy);
}

Json accuracy_document(const PeriodicJob& periodic, const Writing&) {
    const auto* collocation = std::get_if<periodic::CollocationOptions>(&periodic.method);
    return collocation != nullptr ? collocation->accuracy
                                  : std::get<periodic::ShootingOptions>(periodic.method).flow.relative_tolerance;
}

/// A number of one method's options. Where that method is not chosen the key is refused.
template <class Options>
Field<PeriodicJob> method_field(KeySchema described, int Options::*member, int factor = 1) {
    described.by_default(factor * (Options{}.*member));
    return {std::move(described),
            [=](const ValueReader& value, const Job&, PeriodicJob& periodic) {
                auto* options = std::get_if<Options>(&periodic.method);
                const auto number = value.whole();
                if (options == nullptr || !number) return;
                const auto count = static_cast<int>(*number);
                if (count % factor != 0) value.report(fmt::format("must be even, not {}", count));
                options->*member = count / factor;
            },
            [=](const PeriodicJob& periodic, const Writing&) -> Json {
                return factor * (std::get<Options>(periodic.method).*member);
            }};
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
        {key("points", list(state()), "One state per period: [[...], ...].").required_always(),
         [](const ValueReader&, const Job&, OrbitStart&) {},
         [](const OrbitStart& start, const Writing&) { return columns_document(start.points); }}};
    return table;
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

OrbitStart read_start(const ValueReader& value, const Job& job) {
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

/// Keys of the method and of its options.
FieldTable<PeriodicJob> orbit_method_fields() {
    const std::vector<std::string> collocation{"collocation"};
    FieldTable<PeriodicJob> table{
        {key("method", choice(periodic_method_names), "How orbits are solved for.").by_default("multiple_shooting"),
         read_periodic_method,
         [](const PeriodicJob& periodic, const Writing&) -> Json {
             return name_of(periodic.method.index(), periodic_method_names);
         }},
        Field<PeriodicJob>{key("accuracy", above_up_to(0.0, 0.01),
                               "Of the flow, or of the points of a collocation, relative to the scales.")
                               .with("method", {"multiple_shooting", "collocation"}),
                           read_accuracy, accuracy_document}
            .written_after("intervals"),
        method_field(key("nodes", whole(5, most_nodes), "Per period.").with("method", {"finite_difference"}),
                     &periodic::FiniteDifferenceOptions::nodes),
        method_field(key("order", whole(2, highest_order), "Even: twice the number of Gauss points of an interval.")
                         .with("method", collocation),
                     &periodic::CollocationOptions::stages, 2),
        method_field(key("intervals", whole(2, most_nodes), "Per period, to begin with.").with("method", collocation),
                     &periodic::CollocationOptions::intervals)};
    add_fields_of(
        table, solver_fields(), [](auto& periodic) -> auto& { return solver_of(periodic); });
    return table;
}

}  // namespace

const FieldTable<PeriodicJob>& periodic_fields() {
    static const FieldTable<PeriodicJob> table = [] {
        FieldTable<PeriodicJob> fields = orbit_method_fields();
        const FieldTable<PeriodicJob> rest{
            Field<PeriodicJob>{
                key("free", names(), "Parameters that sensitivities are computed for; all unless given."),
                [](const ValueReader& value, const Job& job, PeriodicJob& periodic) {
                    periodic.free.clear();
                    for (const auto& [word, item] : read_names(value))
                        if (const auto index = parameter_named(word, item, job)) periodic.free.push_back(*index);
                },
                [](const PeriodicJob& periodic, const Writing& at) { return parameter_list(at.job, periodic.free); }}
                .written_after("continuation"),
            field(key("stability", boolean(), "Directions, and how the multipliers move with the parameters."),
                  &PeriodicJob::stability)
                .written_after("free"),
            {key("orbits", list(named("orbit_start", object(keys_of(orbit_start_fields()))), 1), "Starts."),
             [](const ValueReader& value, const Job& job, PeriodicJob& periodic) {
                 for (const ValueReader& item : value.items())
                     periodic.orbits.push_back(read_start(item, job));
             },
             [](const PeriodicJob& periodic, const Writing& at) {
                 return periodic.orbits.empty() ? left_out() : list_document(periodic.orbits, orbit_start_fields(), at);
             }},
            {key("search", object(keys_of(orbit_search_fields())), "All orbits up to a period, without starts."),
             read_orbit_search,
             [](const PeriodicJob& periodic, const Writing& at) {
                 return periodic.search ? fields_document(*periodic.search, orbit_search_fields(), at) : left_out();
             }},
            {key("continuation", object(keys_of(continuation_fields()), {"range", "to"}),
                 "A branch of orbits over a parameter, with its bifurcations."),
             read_continuation, [](const PeriodicJob& periodic, const Writing& at) {
                 return periodic.continuation ? fields_document(*periodic.continuation, continuation_fields(), at)
                                              : left_out();
             }}};
        fields.insert(fields.end(), rest.begin(), rest.end());
        return fields;
    }();
    return table;
}

}  // namespace describe

void read_periodic(ObjectReader& root, Job& job) {
    const auto value = root.find("periodic");
    if (!value) return;
    PeriodicJob periodic;
    // A start in a job is a guess, not a measurement: unless told otherwise, whatever orbit it leads to is shown, with
    // its distance.
    periodic::ShootingOptions solver;
    solver.maximum_distance = std::numeric_limits<double>::infinity();
    periodic.method = solver;
    periodic.free.resize(parameter_names(job).size());
    std::iota(periodic.free.begin(), periodic.free.end(), Eigen::Index{0});
    ObjectReader object(*value);
    if (job.model.system && !job.model.system->inputs().empty())
        value->report(fmt::format("the model {} is driven by measured inputs: it has no periodic orbits of its own",
                                  job.model.name));
    read_fields(object, describe::periodic_fields(), periodic, job);
    // Its derivatives hold along the model's own orbit, which the others only approximate.
    if (periodic.stability && periodic.method.index() > 0)
        object.find("stability")->report("needs \"method\": \"multiple_shooting\"; must be false with the others");
    if (object.valid() && !object.find("orbits") && !object.find("search"))
        object.self().report(
            object.find("continuation")
                ? "a branch needs the orbit that it starts at: \"orbits\": [ { \"period\": ..., \"points\": "
                  "[[...], ...] } ], or \"search\": { \"periods\": [...] }"
                : "needs \"orbits\", a list of starts { \"period\": ..., \"points\": [[...], ...] }, or "
                  "\"search\": { \"periods\": [...] }");
    object.finish();
    job.periodic = std::move(periodic);
}

}  // namespace orbid::apps

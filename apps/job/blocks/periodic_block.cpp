#include <cmath>
#include <limits>
#include <numeric>

#include "apps/documents/json_text.hpp"
#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/periodic_job.hpp"

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
        open_field(
            key("maximum_distance", above(0.0),
                "An orbit farther from its start than this, relative to the scales, counts as another one; any unless "
                "given."),
            &Solver::maximum_distance)
            .written_if([](const Solver& solver) { return std::isfinite(solver.maximum_distance); })};
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
                     periodic.orbits.push_back(read_orbit_start(item, job));
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

#include "apps/documents/json_text.hpp"
#include "apps/job/schema/block_fields.hpp"
#include "apps/job/writing/job_writer.hpp"

namespace orbid::apps::detail {

namespace {

using Json = nlohmann::ordered_json;

Json starts_document(const std::vector<OrbitStart>& orbits) {
    return json_list(orbits, [](const OrbitStart& orbit) {
        Json start{{"period", orbit.period}};
        if (orbit.time > 0.0) start["time"] = orbit.time;
        if (!orbit.rotation.empty()) start["rotation"] = orbit.rotation;
        start["points"] = columns_document(orbit.points);
        return start;
    });
}

/// The method with its own options.
struct AddMethod {
    Json& object;

    void operator()(const periodic::ShootingOptions& options) const {
        object["accuracy"] = options.flow.relative_tolerance;
        write_fields(options, describe::solver_fields(), object);
    }
    void operator()(const periodic::FiniteDifferenceOptions& options) const {
        object["nodes"] = options.nodes;
        write_fields(options.solver, describe::solver_fields(), object);
    }
    void operator()(const periodic::CollocationOptions& options) const {
        object["order"] = 2 * options.stages;
        object["intervals"] = options.intervals;
        object["accuracy"] = options.accuracy;
        write_fields(options.solver, describe::solver_fields(), object);
    }
};

Json search_document(const periodic::OrbitSearchOptions& search) {
    const Json initial = columns_document(search.initial);
    return {{"periods", search.periods},   {"points", search.points},     {"trajectories", search.trajectories},
            {"initial", initial},          {"symmetry", search.symmetry}, {"stabilised", search.stabilised},
            {"patience", search.patience}, {"seed", search.seed}};
}

Json continuation_document(const Job& job, const ContinuationJob& continuation) {
    const periodic::ContinuationOptions& options = continuation.options;
    Json object{{"parameter", parameter_name(job, options.parameter)},
                {"range", {options.lower, options.upper}},
                {"direction", options.direction},
                {"orbit", continuation.orbit},
                {"step", fields_document(options, describe::step_fields())}};
    write_fields(options, describe::branch_fields(), object);
    object["plot"] = continuation.plotted ? coordinate_name(job, *continuation.plotted) : "time";
    return object;
}

}  // namespace

Json periodic_document(const Job& job) {
    const PeriodicJob& periodic = *job.periodic;
    Json object{{"method", name_of(periodic.method.index(), periodic_method_names)}};
    std::visit(AddMethod{object}, periodic.method);
    if (!periodic.orbits.empty()) object["orbits"] = starts_document(periodic.orbits);
    if (periodic.search) object["search"] = search_document(*periodic.search);
    if (periodic.continuation) object["continuation"] = continuation_document(job, *periodic.continuation);
    object["free"] = parameter_list(job, periodic.free);
    object["stability"] = periodic.stability;
    return object;
}

}  // namespace orbid::apps::detail

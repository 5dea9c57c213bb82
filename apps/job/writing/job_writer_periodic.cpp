#include <cmath>

#include "apps/job/writing/job_writer.hpp"

namespace orbid::apps::detail {

namespace {

using Json = nlohmann::ordered_json;

Json starts_document(const std::vector<OrbitStart>& orbits) {
    Json starts = Json::array();
    for (const OrbitStart& orbit : orbits) {
        Json start{{"period", orbit.period}};
        if (orbit.time > 0.0) start["time"] = orbit.time;
        if (!orbit.rotation.empty()) start["rotation"] = orbit.rotation;
        start["points"] = Json::array();
        for (Eigen::Index j = 0; j < orbit.points.cols(); ++j)
            start["points"].push_back(state_document(orbit.points.col(j)));
        starts.push_back(std::move(start));
    }
    return starts;
}

void add_solver(const periodic::ShootingOptions& solver, Json& object) {
    object["tolerance"] = solver.tolerance;
    object["maximum_iterations"] = solver.maximum_iterations;
    if (std::isfinite(solver.maximum_distance)) object["maximum_distance"] = solver.maximum_distance;
}

/// The method with its own options.
struct AddMethod {
    Json& object;

    void operator()(const periodic::ShootingOptions& options) const {
        object["accuracy"] = options.flow.relative_tolerance;
        add_solver(options, object);
    }
    void operator()(const periodic::FiniteDifferenceOptions& options) const {
        object["nodes"] = options.nodes;
        add_solver(options.solver, object);
    }
    void operator()(const periodic::CollocationOptions& options) const {
        object["order"] = 2 * options.stages;
        object["intervals"] = options.intervals;
        object["accuracy"] = options.accuracy;
        add_solver(options.solver, object);
    }
};

Json search_document(const periodic::OrbitSearchOptions& search) {
    Json initial = Json::array();
    for (Eigen::Index j = 0; j < search.initial.cols(); ++j)
        initial.push_back(state_document(search.initial.col(j)));
    return {{"periods", search.periods},   {"points", search.points},     {"trajectories", search.trajectories},
            {"initial", initial},          {"symmetry", search.symmetry}, {"stabilised", search.stabilised},
            {"patience", search.patience}, {"seed", search.seed}};
}

Json continuation_document(const Job& job, const ContinuationJob& continuation) {
    const periodic::ContinuationOptions& options = continuation.options;
    Json switches = Json::array();
    if (options.switch_doublings) switches.push_back("period_doubling");
    if (options.switch_symmetry) switches.push_back("symmetry_breaking");
    return {{"parameter", parameter_name(job, options.parameter)},
            {"range", {options.lower, options.upper}},
            {"direction", options.direction},
            {"orbit", continuation.orbit},
            {"step",
             {{"first", options.first_step}, {"smallest", options.smallest_step}, {"largest", options.largest_step}}},
            {"points", options.maximum_points},
            {"branches", options.maximum_branches},
            {"switch", switches},
            {"maximum_period", options.maximum_period},
            {"maximum_time", options.longest},
            {"plot", continuation.plotted ? coordinate_name(job, *continuation.plotted) : "time"}};
}

}  // namespace

Json periodic_document(const Job& job) {
    const PeriodicJob& periodic = *job.periodic;
    Json object{{"method", periodic_method_names[periodic.method.index()]}};
    std::visit(AddMethod{object}, periodic.method);
    if (!periodic.orbits.empty()) object["orbits"] = starts_document(periodic.orbits);
    if (periodic.search) object["search"] = search_document(*periodic.search);
    if (periodic.continuation) object["continuation"] = continuation_document(job, *periodic.continuation);
    object["free"] = Json::array();
    for (const Eigen::Index index : periodic.free)
        object["free"].push_back(parameter_name(job, index));
    object["stability"] = periodic.stability;
    return object;
}

}  // namespace orbid::apps::detail

#include "apps/periodic_stage.hpp"

#include <algorithm>
#include <limits>
#include <numeric>
#include <utility>

#include <fmt/format.h>

#include "apps/cycle_reader.hpp"
#include "apps/orbits_stage.hpp"
#include "apps/stage_fingerprint.hpp"
#include "periodic/solve_orbit.hpp"

namespace orbid::apps {

namespace {

periodic::OrbitMethod method_of(const PeriodicJob& job) {
    periodic::ShootingOptions solver;
    // A start in a job is a guess, not a measurement: whatever orbit it leads to is shown, with its distance.
    solver.maximum_distance = std::numeric_limits<double>::infinity();
    if (periodic_method_names[job.method] == "finite_difference") {
        periodic::FiniteDifferenceOptions options;
        options.solver = solver;
        return options;
    }
    if (periodic_method_names[job.method] == "collocation") {
        periodic::CollocationOptions options;
        options.solver = solver;
        return options;
    }
    return solver;
}

periodic::StartingSolution starting_solution(const Job& job, const OrbitStart& orbit) {
    periodic::StartingSolution start;
    start.points = orbit.points;
    start.rotation = orbit.rotation;
    start.phase = job.section_phase;
    if (job.section_plane) {
        start.section = models::Section{Eigen::VectorXd::Unit(orbit.points.rows(), job.section_plane->coordinate),
                                        job.section_plane->value, job.section_plane->direction};
    }
    return start;
}

}  // namespace

std::vector<periodic::PeriodicOrbit> compute_orbits(const Workspace& work) {
    const Job& job = work.job;
    const models::System& system = work.system();
    std::vector<Eigen::Index> all(system.parameters().size());
    std::iota(all.begin(), all.end(), Eigen::Index{0});
    const periodic::OrbitMethod method = method_of(*job.periodic);

    work.progress.begin("periodic", static_cast<double>(job.periodic->orbits.size()), "orbits");
    std::vector<periodic::PeriodicOrbit> orbits;
    for (const OrbitStart& start : job.periodic->orbits) {
        periodic::PeriodicOrbit orbit =
            periodic::solve_orbit(system, job.model.values, starting_solution(job, start), all, method);
        // Last iterates that are no crossings: the start is shown instead. An equilibrium is all points in one.
        if (orbit.status == periodic::OrbitStatus::equilibrium)
            orbit.points = orbit.points.replicate(1, start.period).eval();
        else if (orbit.points.cols() != start.period)
            orbit.points.resize(0, 0);
        orbits.push_back(std::move(orbit));
        show_start(orbits.back(), start.points);
        work.progress.advance(1.0);
    }
    const auto converged = std::count_if(orbits.begin(), orbits.end(), [](const periodic::PeriodicOrbit& orbit) {
        return orbit.status == periodic::OrbitStatus::converged;
    });
    std::vector<std::string> names;
    for (const models::Parameter& parameter : system.parameters())
        names.emplace_back(parameter.name);
    const Fingerprint fingerprint = stage_fingerprint(work.document, {"/model", "/section", "/periodic"});
    CycleFileHead head = cycle_file_head(job, fingerprint);
    head.coordinates = series_coordinates(system);  // also the one that is the same at all points of the section
    work.folder.store("orbits.json", orbits_text(head, orbits, names));
    work.progress.end(fmt::format("{} of {} converged", converged, orbits.size()));
    return orbits;
}

}  // namespace orbid::apps

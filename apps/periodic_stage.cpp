#include "apps/periodic_stage.hpp"

#include <algorithm>
#include <limits>
#include <numeric>

#include <fmt/format.h>

#include "apps/orbits_stage.hpp"
#include "apps/stage_fingerprint.hpp"
#include "periodic/multiple_shooting.hpp"

namespace orbid::apps {

std::vector<periodic::PeriodicOrbit> compute_orbits(const Workspace& work) {
    const Job& job = work.job;
    const models::System& system = work.system();
    std::vector<Eigen::Index> all(system.parameters().size());
    std::iota(all.begin(), all.end(), Eigen::Index{0});
    periodic::ShootingOptions options;
    // A start in a job is a guess, not a measurement: whatever orbit it leads to is shown, with its distance.
    options.maximum_distance = std::numeric_limits<double>::infinity();

    work.progress.begin("periodic", static_cast<double>(job.periodic->orbits.size()), "orbits");
    std::vector<periodic::PeriodicOrbit> orbits;
    for (const OrbitStart& start : job.periodic->orbits) {
        orbits.push_back(periodic::solve_multiple_shooting(system, job.model.values, job.section_phase, start.points,
                                                           start.rotation, all, options));
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
    work.folder.store("orbits.json", orbits_text(cycle_file_head(job, fingerprint), orbits, names));
    work.progress.end(fmt::format("{} of {} converged", converged, orbits.size()));
    return orbits;
}

}  // namespace orbid::apps

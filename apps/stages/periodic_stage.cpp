#include "apps/stages/periodic_stage.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include "apps/documents/atomic_file.hpp"
#include "apps/job/orbits_job.hpp"
#include "apps/job/periodic_job.hpp"
#include "apps/results/orbit_file.hpp"
#include "apps/stages/model_section_plot.hpp"
#include "apps/stages/orbits_stage.hpp"
#include "apps/stages/workspace.hpp"
#include "models/system/stopped.hpp"
#include "periodic/search/index_sum.hpp"
#include "periodic/solution/solve_orbit.hpp"

namespace orbid::apps {

namespace {

using periodic::OrbitStatus;

periodic::StartingSolution starting_solution(const Job& job, const OrbitStart& orbit) {
    periodic::StartingSolution start;
    start.points = orbit.points;
    start.rotation = orbit.rotation;
    start.phase = job.section_phase;
    start.section = job_section(job);
    start.time = orbit.time;
    return start;
}

/// Lists hold one point per period. Last iterates that are no points of the section: the start is shown instead, and no
/// residual that could pass for an answer. An equilibrium is all points in one. Where no section says which points are
/// meant, the first one stands for the orbit.
void show_in_list(periodic::PeriodicOrbit& orbit, const periodic::StartingSolution& start) {
    const Eigen::Index period = start.points.cols();
    const Eigen::Index n = start.points.rows();
    if (orbit.status == OrbitStatus::equilibrium) orbit.points = orbit.points.replicate(1, period).eval();
    if (start.time > 0.0 && orbit.points.cols() > 1) {
        orbit.points = orbit.points.leftCols(1).eval();
        if (orbit.times.size() > 1) orbit.times = orbit.times.head(1).eval();
        if (orbit.sensitivities.rows() > n) orbit.sensitivities = orbit.sensitivities.topRows(n).eval();
    }
    orbit.period = static_cast<int>(period);
    if (orbit.points.cols() == period) return;
    orbit.points = start.points;
    orbit.residual = std::numeric_limits<double>::quiet_NaN();
}

ComputedOrbit computed_from(const Job& job, const periodic::StartingSolution& start) {
    const models::System& system = *job.model.system;
    const PeriodicJob& periodic = *job.periodic;
    ComputedOrbit computed;
    computed.orbit = periodic::solve_orbit(system, job.model.values, start, periodic.free, periodic.method);
    if (computed.converged() && periodic.stability) {
        periodic::StabilityOptions options;
        computed.stability =
            periodic::stability(system, job.model.values, job.section_phase, computed.orbit, periodic.free, options);
        // Directions of the points that are listed.
        if (start.time > 0.0 && computed.stability->directions.size() > 1) computed.stability->directions.resize(1);
    }
    if (computed.converged())
        computed.amplitude =
            periodic::amplitude_of(system, job.model.values, job.section_phase, computed.orbit, models::FlowOptions{});
    computed.message = orbit_message(computed.orbit, start.rotation);
    show_in_list(computed.orbit, start);
    return computed;
}

ComputedOrbit not_computed(const periodic::StartingSolution& start) {
    ComputedOrbit computed;
    computed.computed = false;
    computed.message = "the run was interrupted before its turn";
    show_in_list(computed.orbit, start);
    return computed;
}

/// An orbit whose flows are left after a stop was requested is not computed either.
ComputedOrbit computed_or_not(const Workspace& work, const periodic::StartingSolution& start) {
    if (work.interruption.asked()) return not_computed(start);
    try {
        return computed_from(work.job, start);
    } catch (const models::Stopped&) {
        return not_computed(start);
    }
}

/// Index sums of the periods 1, 2, ... as far as all of them were asked for. Of forced models only: the section of
/// another one need not be mapped into itself without tearing.
std::vector<int> index_sums_of(const models::System& system, const std::vector<int>& sorted_periods,
                               const std::vector<periodic::FoundOrbit>& found) {
    if (system.kind() != models::Kind::forced) return {};
    int longest = 0;
    while (static_cast<std::size_t>(longest) < sorted_periods.size() &&
           sorted_periods[static_cast<std::size_t>(longest)] == longest + 1)
        ++longest;
    std::vector<periodic::PeriodicOrbit> orbits;
    for (const periodic::FoundOrbit& orbit : found)
        orbits.push_back(orbit.orbit);
    return longest > 0 ? periodic::index_sums(orbits, longest) : std::vector<int>{};
}

/// What a search finds, computed like the starts of the job, from the found points. Mirror images are counted from
/// `first`, the place of the first one in the list.
void add_found(const Workspace& work, ComputedOrbits& orbits) {
    const Job& job = work.job;
    periodic::OrbitSearchOptions options = *job.periodic->search;
    options.phase = job.section_phase;
    options.section = job_section(job);
    if (const auto* shooting = std::get_if<periodic::ShootingOptions>(&job.periodic->method)) {
        options.solver = *shooting;
        // What is far from its start is another orbit, which the search finds from a start of its own.
        options.solver.maximum_distance = periodic::ShootingOptions{}.maximum_distance;
    }
    options.interrupted = [&work] { return work.interruption.asked(); };
    options.progress = [&work](std::size_t starts, std::size_t found) {
        work.progress.at(static_cast<double>(starts), fmt::format("{} orbits from {} starts", found, starts));
    };
    work.progress.begin("search", 0.0, "starts");
    const periodic::OrbitSearch search = periodic::search_orbits(work.system(), job.model.values, options);
    work.progress.end(fmt::format("{} orbits from {} starts", search.orbits.size(), search.starts));
    orbits.searched = true;
    orbits.starts = search.starts;
    orbits.captured = search.captured;
    std::vector<int> periods = options.periods;
    std::sort(periods.begin(), periods.end());
    for (std::size_t i = 0; i < periods.size(); ++i)
        if (!search.settled[i]) orbits.unsettled.push_back(periods[i]);
    orbits.index_sums = index_sums_of(work.system(), periods, search.orbits);
    const std::size_t first = orbits.list.size();
    work.progress.begin("found orbits", static_cast<double>(search.orbits.size()), "orbits");
    orbits.list.resize(first + search.orbits.size());
    tbb::parallel_for(std::size_t{0}, search.orbits.size(), [&](std::size_t i) {
        const periodic::FoundOrbit& found = search.orbits[i];
        const periodic::StartingSolution start = starting_solution(job, found.orbit);
        ComputedOrbit& computed = orbits.list[first + i];
        // After an interruption what the search itself knows has to do: no sensitivities, no stability.
        computed = computed_or_not(work, start);
        if (!computed.computed) {
            computed = ComputedOrbit{};
            computed.orbit = found.orbit;
        }
        computed.origin = std::string(periodic::name(found.origin));
        computed.hits = found.hits;
        if (found.mirror >= 0) computed.mirror = static_cast<int>(first) + found.mirror;
        work.progress.advance(1.0);
    });
    work.progress.end();
}

void compute_starts(const Workspace& work, ComputedOrbits& orbits) {
    const std::vector<OrbitStart>& starts = work.job.periodic->orbits;
    work.progress.begin("periodic", static_cast<double>(starts.size()), "orbits");
    orbits.list.resize(starts.size());
    tbb::parallel_for(std::size_t{0}, starts.size(), [&](std::size_t i) {
        const periodic::StartingSolution start = starting_solution(work.job, starts[i]);
        orbits.list[i] = computed_or_not(work, start);
        work.progress.advance(1.0);
    });
    work.progress.end(fmt::format("{} of {} converged", orbits.converged(), orbits.list.size()));
}

Fingerprint orbits_fingerprint(const Workspace& work) {
    std::vector<std::string_view> places{"/model", "/section", "/flow"};
    // All of the block but the branches, which begin where this ends.
    std::vector<std::string> keys;
    for (const auto& [key, value] : work.document.at("periodic").items())
        if (key != "continuation") keys.push_back("/periodic/" + key);
    places.insert(places.end(), keys.begin(), keys.end());
    return stage_fingerprint(work.document, places);
}

std::optional<ComputedOrbits> orbits_from_folder(const Workspace& work, const Fingerprint& wanted) {
    const auto file = work.file("orbits.json");
    if (!std::filesystem::exists(file)) return std::nullopt;
    auto stored = stored_orbits(read_whole_file(file));
    if (!reusable(work, Stage::periodic, file, stored ? stored->fingerprint : std::string(), wanted))
        return std::nullopt;
    return std::move(stored->orbits);
}

void store_picture(const Workspace& work, const ComputedOrbits& orbits) {
    try {
        // A search in data has a picture of its own.
        if (const auto picture = model_section_svg(work.job, orbits))
            work.folder.store(work.job.orbits ? "model_section.svg" : "section.svg", *picture);
    } catch (const models::Stopped&) {
        // The orbits are stored. They can do without their background.
    }
}

}  // namespace

std::optional<models::Section> job_section(const Job& job) {
    if (!job.section_plane) return std::nullopt;
    return models::Section{Eigen::VectorXd::Unit(job.model.system->dimension(), job.section_plane->coordinate),
                           job.section_plane->value, job.section_plane->direction};
}

periodic::StartingSolution starting_solution(const Job& job, const periodic::PeriodicOrbit& orbit) {
    const bool free_mesh = job.model.is(models::Kind::autonomous) && !job.section_plane;
    return starting_solution(job, OrbitStart{orbit.period, orbit.rotation, orbit.points, free_mesh ? orbit.time : 0.0});
}

ComputedOrbits compute_orbits(const Workspace& work) {
    const Job& job = work.job;
    const models::System& system = work.system();
    const Fingerprint wanted = orbits_fingerprint(work);
    if (auto stored = orbits_from_folder(work, wanted)) {
        work.progress.reused("periodic", fmt::format("{} orbits from orbits.json", stored->list.size()));
        stored->own_time = system.kind() == models::Kind::autonomous;
        return std::move(*stored);
    }
    ComputedOrbits orbits;
    orbits.own_time = system.kind() == models::Kind::autonomous;
    if (!job.periodic->orbits.empty()) compute_starts(work, orbits);
    if (job.periodic->search && !work.interruption.asked()) add_found(work, orbits);
    orbits.interrupted = work.interruption.asked();
    std::vector<std::string> names;
    for (const Eigen::Index index : job.periodic->free)
        names.emplace_back(system.parameters()[static_cast<std::size_t>(index)].name);
    CycleFileHead head = cycle_file_head(job, orbits.interrupted ? Fingerprint{} : wanted);
    head.coordinates = series_coordinates(system);  // also the one that is the same at all points of the section
    work.folder.store("orbits.json", orbits_text(head, orbits, names));
    if (orbits.searched) store_picture(work, orbits);
    return orbits;
}

}  // namespace orbid::apps

#include "apps/job/job_parts.hpp"

namespace orbid::apps {

namespace {

/// States from which the first trajectories begin.
void read_search_states(const ValueReader& value, const Job& job, periodic::OrbitSearchOptions& search) {
    std::vector<Eigen::VectorXd> states;
    for (const ValueReader& item : value.items())
        if (const auto state = read_state(item, job)) states.push_back(*state);
    if (!job.model.system) return;
    search.initial.resize(job.model.system->dimension(), static_cast<Eigen::Index>(states.size()));
    for (std::size_t j = 0; j < states.size(); ++j)
        search.initial.col(static_cast<Eigen::Index>(j)) = states[j];
}

}  // namespace

void read_orbit_search(const ValueReader& value, const Job& job, PeriodicJob& periodic) {
    periodic::OrbitSearchOptions& search = periodic.search.emplace();
    search.seed = job.seed;
    search.symmetry = job.model.system && job.model.system->symmetry().has_value();
    ObjectReader object(value);
    if (const auto periods = object.find("periods")) search.periods = read_periods(*periods).value_or(search.periods);
    if (const auto points = object.find("points"))
        search.points = static_cast<std::size_t>(points->whole().value_or(search.points));
    if (const auto trajectories = object.find("trajectories"))
        search.trajectories = static_cast<std::size_t>(trajectories->whole().value_or(search.trajectories));
    if (const auto initial = object.find("initial")) read_search_states(*initial, job, search);
    if (const auto patience = object.find("patience"))
        search.patience = static_cast<std::size_t>(patience->whole().value_or(search.patience));
    if (const auto seed = object.find("seed")) search.seed = seed->whole().value_or(search.seed);
    if (const auto stabilised = object.find("stabilised"))
        search.stabilised = stabilised->boolean().value_or(search.stabilised);
    if (const auto symmetry = object.find("symmetry")) {
        const bool usable = search.symmetry;
        search.symmetry = symmetry->boolean().value_or(usable);
        if (search.symmetry && !usable && job.model.system)
            symmetry->report(fmt::format("the model {} declares no symmetry; must be false", job.model.name));
    }
    object.finish();
    if (job.model.system && job.model.system->kind() == models::Kind::autonomous && !job.section_plane)
        value.report(
            fmt::format("the model {} is autonomous: needs a \"section\" in the job that its orbits cross: {{ "
                        "\"coordinate\": ..., \"value\": ..., \"direction\": ... }}",
                        job.model.name));
}

}  // namespace orbid::apps

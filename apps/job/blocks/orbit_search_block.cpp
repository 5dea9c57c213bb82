#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/periodic_job.hpp"

namespace orbid::apps::describe {

namespace {

// 16 GB of doubles of a plane model; beyond that recurrences gain nothing that stabilised starts do not find.
constexpr double most_search_points = 1e9;
constexpr double fewest_points = 100;  // rule of OrbitSearchOptions::points
constexpr double most_search_trajectories = 65536;
constexpr double most_patience = 1e9;  // tries every start there is

/// States from which the first trajectories begin.
void read_search_states(const ValueReader& value, const Job& job, periodic::OrbitSearchOptions& search) {
    const std::vector<Eigen::VectorXd> states = read_states(value, job);
    if (!job.model.system) return;
    search.initial.resize(job.model.system->dimension(), static_cast<Eigen::Index>(states.size()));
    for (std::size_t j = 0; j < states.size(); ++j)
        search.initial.col(static_cast<Eigen::Index>(j)) = states[j];
}

}  // namespace

const FieldTable<periodic::OrbitSearchOptions>& orbit_search_fields() {
    using Options = periodic::OrbitSearchOptions;
    static const FieldTable<Options> table{
        {key("periods", periods(), "In periods of the forcing, iterations, or crossings of the section.")
             .required_always(),
         [](const ValueReader& value, const Job&, Options& search) {
             search.periods = read_periods(value).value_or(search.periods);
         },
         [](const Options& search, const Writing&) -> nlohmann::ordered_json { return search.periods; }},
        field(key("points", whole(fewest_points, most_search_points), "Of the section that are simulated."),
              &Options::points),
        field(key("trajectories", whole(1, most_search_trajectories), "Simulated at a time, from random states."),
              &Options::trajectories),
        {key("initial", list(state()), "States from which the first trajectories begin.").standard_text("[]"),
         read_search_states, [](const Options& search, const Writing&) { return columns_document(search.initial); }},
        field(
            key("patience", whole(1, most_patience), "Starts in a row that find nothing new before the rest is left."),
            &Options::patience)
            .written_after("stabilised"),
        open_field(key("seed", seed(), "Of the random states; the job's unless given."), &Options::seed)
            .written_after("patience"),
        field(key("stabilised", boolean(), "As the last resort stabilised iterations."), &Options::stabilised)
            .written_after("symmetry"),
        Field<Options>{key("symmetry", boolean(),
                           "Look for the mirror image of every orbit; true where the model declares a symmetry."),
                       [](const ValueReader& value, const Job& job, Options& search) {
                           const bool usable = search.symmetry;
                           value.read(search.symmetry);
                           if (search.symmetry && !usable && job.model.system)
                               value.report(
                                   fmt::format("the model {} declares no symmetry; must be false", job.model.name));
                       },
                       [](const Options& search, const Writing&) -> nlohmann::ordered_json { return search.symmetry; }}
            .written_after("initial")};
    return table;
}

void read_orbit_search(const ValueReader& value, const Job& job, PeriodicJob& periodic) {
    periodic::OrbitSearchOptions& search = periodic.search.emplace();
    search.seed = job.seed;
    search.symmetry = job.model.system && job.model.system->symmetry().has_value();
    read_object(value, orbit_search_fields(), search, job);
    if (job.model.is(models::Kind::autonomous) && !job.section_plane)
        value.report(
            fmt::format("the model {} is autonomous: needs a \"section\" in the job that its orbits cross: {{ "
                        "\"coordinate\": ..., \"value\": ..., \"direction\": ... }}",
                        job.model.name));
}

}  // namespace orbid::apps::describe

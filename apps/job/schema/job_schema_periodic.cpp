#include "apps/job/periodic_job.hpp"
#include "apps/job/schema/block_fields.hpp"
#include "apps/job/schema/job_schema.hpp"
#include "periodic/solution/collocation.hpp"
#include "periodic/solution/finite_difference.hpp"

namespace orbid::apps::describe {

namespace {

// Enough for any orbit this program can hold; the limits keep the numbers ints.
constexpr double most_nodes = 1e6;
// Gauss points per interval that CollocationOptions allows, twice.
constexpr double highest_order = 20;
// 16 GB of doubles of a plane model; beyond that recurrences gain nothing that stabilised starts do not find.
constexpr double most_search_points = 1e9;
constexpr double fewest_points = 100;  // rule of OrbitSearchOptions::points
constexpr double most_search_trajectories = 65536;
constexpr double most_patience = 1e9;  // tries every start there is
// Beyond any picture and any memory; the limit only keeps the number in its type.
constexpr double most_found = 1e6;
// More turns than this per orbit no pendulum makes; the limit keeps the number an int.
constexpr double most_turns = 1e6;

ValueSchema orbit_start() {
    const ValueSchema turns = whole(-most_turns, most_turns);
    return named(
        "orbit_start",
        object(
            {key("period", whole(1, longest_computed_period),
                 "In periods of the forcing, iterations, or crossings of the section."),
             key("time", above(0.0), "Autonomous models without a section: length of the orbit, about.").in("s"),
             key("rotation", turns | list(turns), "Turns of each angle along the orbit; from the points unless given."),
             key("points", list(state()), "One state per period: [[...], ...].").required_always()}));
}

ValueSchema search() {
    const periodic::OrbitSearchOptions usual;
    return object(
        {key("periods", periods(), "In periods of the forcing, iterations, or crossings of the section.")
             .required_always(),
         key("points", whole(fewest_points, most_search_points), "Of the section that are simulated.")
             .by_default(usual.points),
         key("trajectories", whole(1, most_search_trajectories), "Simulated at a time, from random states.")
             .by_default(usual.trajectories),
         key("initial", list(state()), "States from which the first trajectories begin.").standard_text("[]"),
         key("patience", whole(1, most_patience), "Starts in a row that find nothing new before the rest is left.")
             .by_default(usual.patience),
         key("seed", seed(), "Of the random states; the job's unless given."),
         key("stabilised", boolean(), "As the last resort stabilised iterations.").by_default(usual.stabilised),
         key("symmetry", boolean(),
             "Look for the mirror image of every orbit; true where the model declares a symmetry.")});
}

ValueSchema continuation() {
    const periodic::ContinuationOptions usual;
    std::vector<KeySchema> keys{
        key("parameter", text(), "The parameter that is followed.").required_always(),
        key("range", list(number(), 2, 2, "[lower, upper]"), "Its values; contains the model's own."),
        key("to", number(), "Where the branch ends that starts at the model's own value."),
        key("from", anything(), "")
            .refuse("a branch starts at the model's own value of the parameter: \"to\" says where it ends, or "
                    "\"range\": [lower, upper]"),
        key("direction", one_of({1.0, -1.0, 0.0}),
            "First to larger values (1), to smaller ones (-1), or both ways (0).")
            .by_default(usual.direction)
            .without("to"),
        key("orbit", whole(0, most_found), "Of the list in orbits.json, where the branch starts; from 0.")
            .by_default(0),
        key("step", object(keys_of(step_fields())), "Steps along the branch, relative to the scales and the range.")};
    const auto branch = keys_of(branch_fields());
    keys.insert(keys.end(), branch.begin(), branch.end());
    keys.push_back(key("plot", text(), "What branch.svg shows: a coordinate, or \"time\"."));
    return object(std::move(keys), {"range", "to"});
}

}  // namespace

ValueSchema periodic_block() {
    const std::vector<std::string> differences{"finite_difference"};
    const std::vector<std::string> collocation{"collocation"};
    std::vector<KeySchema> keys{
        key("method", choice(periodic_method_names), "How orbits are solved for.").by_default("multiple_shooting"),
        key("accuracy", above_up_to(0.0, 0.01),
            "Of the flow, or of the points of a collocation, relative to the scales.")
            .with("method", {"multiple_shooting", "collocation"}),
        key("nodes", whole(5, most_nodes), "Per period.")
            .by_default(periodic::FiniteDifferenceOptions{}.nodes)
            .with("method", differences),
        key("order", whole(2, highest_order), "Even: twice the number of Gauss points of an interval.")
            .by_default(2 * periodic::CollocationOptions{}.stages)
            .with("method", collocation),
        key("intervals", whole(2, most_nodes), "Per period, to begin with.")
            .by_default(periodic::CollocationOptions{}.intervals)
            .with("method", collocation)};
    const auto solver = keys_of(solver_fields());
    keys.insert(keys.end(), solver.begin(), solver.end());
    keys.insert(
        keys.end(),
        {key("free", names(), "Parameters that sensitivities are computed for; all unless given."),
         key("stability", boolean(), "Directions, and how the multipliers move with the parameters.").by_default(false),
         key("orbits", list(orbit_start(), 1), "Starts."),
         key("search", search(), "All orbits up to a period, without starts."),
         key("continuation", continuation(), "A branch of orbits over a parameter, with its bifurcations.")});
    return object(std::move(keys));
}

}  // namespace orbid::apps::describe

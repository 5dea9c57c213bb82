#include "apps/job/schema/job_schema.hpp"

#include <algorithm>

#include "apps/job/job.hpp"

namespace orbid::apps {

namespace describe {

namespace {

// A local fit over more points than this is no longer local in any series of usable length.
constexpr double most_neighbours = 100000;
// The least that a local map of one coordinate takes: two coefficients and two more.
constexpr double fewest_neighbours = 4;
// Only guards the conversion to int.
constexpr double most_recurrences = 1e9;

bool is_plain_name(std::string_view word) {
    const auto letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; };
    const auto digit = [](char c) { return c >= '0' && c <= '9'; };
    return !word.empty() && letter(word.front()) &&
           std::all_of(word.begin(), word.end(), [&](char c) { return letter(c) || digit(c); });
}

bool is_sha256(std::string_view word) {
    return word.size() == 64 && std::all_of(word.begin(), word.end(),
                                            [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
}

bool is_not_empty(std::string_view word) {
    return !word.empty();
}

ValueSchema output_block() {
    return object(
        {key("series", choice(series_output_names), "How the series of the job are stored.").by_default("h5")});
}

ValueSchema flow_block() {
    return object({key("stepper", choice(flow_stepper_names),
                       "What takes the steps of flows: the library's own stepper, or Boost.Odeint's, for smooth models "
                       "that are not stiff; an independent way to the same numbers.")
                       .by_default("verner")});
}

ValueSchema partition() {
    return object({key("coordinate", text(), "The coordinate whose value decides about the symbol.").required_always(),
                   key("boundaries", list(number()), "Values between the parts, ascending.").required_always(),
                   key("symbols", text(), "One character per part, from below.").required_always()});
}

ValueSchema invariants() {
    return boolean() |
           object({key("complete_to", whole(1, longest_period),
                       "The period up to which the list of cycles is complete: a cycle expansion is made besides.")
                       .required_always(),
                   key("continuous", boolean(), "The map of the section onto itself is continuous.")
                       .by_default(orbits::CycleExpansionOptions{}.continuous)});
}

}  // namespace

ValueSchema state() {
    return list(number());
}

ValueSchema matrix() {
    return list(list(number()));
}

ValueSchema names(std::size_t fewest) {
    return set(text(), fewest);
}

ValueSchema periods() {
    return set(whole(1, longest_period), 1);
}

ValueSchema file_name() {
    return text_like(is_not_empty, "^.", "the name of a file");
}

ValueSchema header() {
    return text_like(is_not_empty, "^.", "the header of a column");
}

ValueSchema sha256() {
    return text_like(is_sha256, "^[0-9a-f]{64}$", "64 hexadecimal digits in lower case");
}

ValueSchema seed() {
    return whole(0, largest_exact);
}

ValueSchema name() {
    return text_like(is_plain_name, "^[A-Za-z_][A-Za-z0-9_]*$", "a name: letters, digits and _, no digit first");
}

ValueSchema section_block() {
    return object(
        {key("phase", number(), "Forced models: the phase omega t at which the state is read.")
             .in("rad")
             .by_default(0.0),
         key("coordinate", text(), "Autonomous models: the coordinate that has the same value at all crossings."),
         // Needed beside a coordinate: whether a section has one depends on the model.
         key("value", number(), "The value it is crossed at.").with("coordinate"),
         key("direction", one_of({1.0, -1.0}), "Crossed while the coordinate rises (1) or falls (-1).")
             .with("coordinate")
             .by_default(1)});
}

ValueSchema orbits_block() {
    const orbits::CycleSearchOptions usual;
    return object(
        {key("file", file_name(), "A list of cycles (cycles.json) to be used as it is, in the place of a search."),
         key("sha256", sha256(), "Of that file: refused if it has changed.").with("file"),
         key("method", choice(cycle_method_names),
             "How the map of the section onto itself is told from the data; \"closest_return\" is the paper's way.")
             .by_default("auto")
             .without("file"),
         key("periods", periods(), "The periods that are searched for.").by_default(usual.periods).without("file"),
         key("box", between(0.0, 0.5),
             "Linear size of a recurrence box relative to the range of the series; 0.01 with \"closest_return\".")
             .by_default(usual.box)
             .without("file"),
         key("local_map", choice(local_map_names),
             "Order of the local maps; left to the data, cycle by cycle, with \"auto\".")
             .by_default("auto")
             .without("file"),
         key("neighbours", whole(fewest_neighbours, most_neighbours),
             "Points of a local fit: at least its coefficients and two more; chosen by the data unless given.")
             .without("file"),
         key("minimum_recurrences", whole(1, most_recurrences),
             "Points of the series that lead to a cycle; cycles with fewer are left out (\"closest_return\": 3).")
             .by_default(usual.minimum_recurrences)
             .without("file"),
         key("symmetry", boolean(),
             "Use the symmetry that the model declares; where it has one that maps the section onto "
             "itself, the default is true.")
             .without("file"),
         key("reading_error", choice({"estimate"}) | entries(above(0.0), "a coordinate of the section"),
             "Standard deviations of a reading, of all coordinates that the section has.")
             .by_default("estimate")
             .without("file"),
         key("partition", partition(), "Names parts of the section, so that cycles get codes.").without("file"),
         key("invariants", invariants(), "Exponents, dimensions and entropies of the series.")
             .by_default(false)
             .without("file")});
}

}  // namespace describe

const ValueSchema& job_description() {
    using namespace describe;
    static const ValueSchema job = object(
        {key("$schema", text(), "The schema that editors check the job with; `orbid schema` prints it."),
         key("format", choice({"orbid-job/1"}), "Written into job.json."),
         key("versions", entries(text(), "a program"), "Written into job.json: what wrote it."),
         key("title", text(), "What the job is about, in one line.").by_default(""),
         key("model", model_block(), "The equations and the values of their parameters.").required_always(),
         key("seed", seed(), "Of all random numbers.").by_default(1),
         key("section", section_block(), "Where orbits are cut: a phase of the forcing, or a plane."),
         key("flow", flow_block(), "How flows are computed; `orbid check --flow` compares the ways."),
         key("data", data_block() | list(data_block(), 1), "An experiment, or a list of them."),
         key("orbits", orbits_block(), "Search for unstable periodic orbits in the section series, or a file of them."),
         key("periodic", periodic_block(), "Periodic orbits of the model itself."),
         key("estimate", estimate_block(), "Parameters from the data."),
         key("reference", entries(number(), "a parameter or derived quantity"),
             "Known values: the result shows deviations from them."),
         key("output", output_block(), "What is stored.")});
    return job;
}

}  // namespace orbid::apps

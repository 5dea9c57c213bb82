#include "apps/job/blocks/job_schema.hpp"

#include <algorithm>

#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/model_block.hpp"

namespace orbid::apps {

namespace describe {

namespace {

bool is_plain_name(std::string_view word) {
    const auto letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; };
    const auto digit = [](char c) { return c >= '0' && c <= '9'; };
    return !word.empty() && word.size() <= 100 && letter(word.front()) &&
           std::all_of(word.begin(), word.end(), [&](char c) { return letter(c) || digit(c); });
}

bool is_sha256(std::string_view word) {
    return word.size() == 64 && std::all_of(word.begin(), word.end(),
                                            [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
}

bool is_not_empty(std::string_view word) {
    return !word.empty();
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
    return text_like(is_plain_name, "^[A-Za-z_][A-Za-z0-9_]{0,99}$",
                     "a name: letters, digits and _, no digit first, at most 100 characters");
}

const FieldTable<Job>& flow_fields() {
    static const FieldTable<Job> table{
        choice_field(key("stepper", {},
                         "What takes the steps of flows: the library's own stepper, or Boost.Odeint's, for smooth "
                         "models that are not stiff; an independent way to the same numbers."),
                     flow_stepper_names, &Job::stepper)};
    return table;
}

const FieldTable<Job>& output_fields() {
    static const FieldTable<Job> table{choice_field(key("series", {}, "How the series of the job are stored."),
                                                    series_output_names, &Job::series_output)};
    return table;
}

}  // namespace describe

const ValueSchema& job_description() {
    using namespace describe;
    static const ValueSchema job = object(
        {key("$schema", text(), "The schema that editors check the job with; `orbid schema` prints it."),
         key("format", choice({"orbid-job/1"}), "Written into job.json."),
         key("versions", entries(text(), "a program"), "Written into job.json: what wrote it."),
         key("title", text(), "What the job is about, in one line.").by_default(""),
         key("model", object(keys_of(model_fields())), "The equations and the values of their parameters.")
             .required_always(),
         key("seed", seed(), "Of all random numbers.").by_default(1),
         key("section", section_block(), "Where orbits are cut: a phase of the forcing, or a plane."),
         key("flow", object(keys_of(flow_fields())), "How flows are computed; `orbid check --flow` compares the ways."),
         key("data", data_block() | list(data_block(), 1), "An experiment, or a list of them."),
         key("orbits", object(keys_of(orbits_fields())),
             "Search for unstable periodic orbits in the section series, or a file of them."),
         key("periodic", object(keys_of(periodic_fields())), "Periodic orbits of the model itself."),
         key("estimate", object(keys_of(estimate_fields())), "Parameters from the data."),
         key("reference", entries(number(), "a parameter or derived quantity"),
             "Known values: the result shows deviations from them."),
         key("output", object(keys_of(output_fields())), "What is stored.")});
    return job;
}

}  // namespace orbid::apps

#include <algorithm>

#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/periodic_job.hpp"
#include "periodic/waveforms/branch_residual.hpp"

namespace orbid::apps::describe {

namespace {

using Options = periodic::ContinuationOptions;
using periodic::OrbitMeasure;

// Beyond any picture and any memory; the limits only keep numbers in their types.
constexpr double most_branch_points = 1e6;
constexpr double most_branches = 1e4;
constexpr double most_found = 1e6;

const std::vector<std::string> switch_names{"period_doubling", "symmetry_breaking"};

/// "step" of a continuation.
const FieldTable<Options>& step_fields() {
    static const FieldTable<Options> table{
        field(key("first", above(0.0), "First step along the branch."), &Options::first_step),
        field(key("smallest", above(0.0), "The branch ends below it."), &Options::smallest_step),
        field(key("largest", above(0.0), "Largest step along the branch."), &Options::largest_step)};
    return table;
}

/// How far a continuation goes.
const FieldTable<Options>& branch_fields() {
    static const FieldTable<Options> table{
        field(key("points", whole(2, most_branch_points), "Per branch, at most."), &Options::maximum_points),
        field(key("branches", whole(1, most_branches), "At most."), &Options::maximum_branches),
        {key("switch", set(choice(switch_names)), "Bifurcations at which the branch that begins there is followed.")
             .standard_text(R"(["period_doubling", "symmetry_breaking"])"),
         [](const ValueReader& value, const Job&, Options& options) {
             options.switch_doublings = options.switch_symmetry = false;
             for (const ValueReader& item : value.items()) {
                 const auto word = item.choice(switch_names);
                 if (word) (*word == 0 ? options.switch_doublings : options.switch_symmetry) = true;
             }
         },
         [](const Options& options, const Writing&) {
             auto words = nlohmann::ordered_json::array();
             if (options.switch_doublings) words.push_back(switch_names[0]);
             if (options.switch_symmetry) words.push_back(switch_names[1]);
             return words;
         }},
        field(key("maximum_period", whole(1, longest_computed_period), "No branch of a longer period is followed."),
              &Options::maximum_period),
        field(key("maximum_time", above(0.0), "Autonomous models: an orbit longer than this ends the branch.").in("s"),
              &Options::longest)};
    return table;
}

void read_step(const ValueReader& value, const Job&, ContinuationJob& continuation) {
    Options& options = continuation.options;
    ObjectReader object(value);
    read_fields(object, step_fields(), options);
    const auto first = object.find("first");
    const auto smallest = object.find("smallest");
    const auto largest = object.find("largest");
    if (options.smallest_step > options.largest_step) {
        (smallest ? *smallest : *largest)
            .report(fmt::format("the smallest step, {}, is above the largest, {}", options.smallest_step,
                                options.largest_step));
    } else if (first && !(options.first_step >= options.smallest_step && options.first_step <= options.largest_step)) {
        first->report(fmt::format("must be between the smallest and the largest step, {} and {}, not {}",
                                  options.smallest_step, options.largest_step, options.first_step));
    }
    // Only said: a first step that nobody gave fits the others.
    options.first_step = std::clamp(options.first_step, std::min(options.smallest_step, options.largest_step),
                                    std::max(options.smallest_step, options.largest_step));
    object.finish();
}

/// An end of the range: a value of the parameter, or the edge of its domain, which the branch comes near.
std::optional<double> read_end(const ValueReader& value, Eigen::Index parameter, const Job& job) {
    const models::Domain domain = job.model.parameter(parameter).domain;
    if (domain == models::Domain::positive && value.is(JsonValue::Kind::number) && value.value().number == 0.0)
        return 0.0;
    return read_parameter_value(value, parameter, job);
}

/// "range": [lower, upper], both ways or in a "direction" first; or "to": value, from the model's own.
void read_range(ObjectReader& object, const Job& job, std::optional<Eigen::Index> parameter,
                periodic::ContinuationOptions& options) {
    const auto range = object.find("range");
    const auto to = object.find("to");
    if (!parameter) return;
    const double start = job.model.values[*parameter];
    const std::string_view name = job.model.parameter(*parameter).name;
    if (range) {
        const auto items = range->items();
        if (items.size() != 2) return;
        const auto lower = read_end(items[0], *parameter, job);
        const auto upper = read_end(items[1], *parameter, job);
        if (!lower || !upper) return;
        options.lower = *lower;
        options.upper = *upper;
        if (!(*lower < *upper)) {
            range->report(fmt::format("is empty: {} must be below {}", *lower, *upper));
        } else if (!(*lower <= start && start <= *upper)) {
            range->report(
                fmt::format("must contain the value that the branch starts at: the model's {} is {}", name, start));
        }
    } else if (to) {
        const auto end = read_end(*to, *parameter, job);
        if (!end) return;
        if (*end == start) to->report(fmt::format("is where the branch starts: the model's {} is {}", name, start));
        options.lower = std::min(start, *end);
        options.upper = std::max(start, *end);
        options.direction = *end > start ? 1 : -1;
    }
}

constexpr OrbitMeasure amplitudes[] = {OrbitMeasure::maximum, OrbitMeasure::minimum, OrbitMeasure::mean,
                                       OrbitMeasure::half_range, OrbitMeasure::rms};

/// What branch.svg shows: a coordinate, a measure of one, "frequency", or "time".
std::optional<Eigen::Index> read_plotted(ObjectReader& object, const Job& job, std::optional<OrbitMeasure>& measure) {
    if (const auto plot = object.find("plot")) {
        const auto name = plot->text();
        if (!name || *name == "time" || !job.model.system) return std::nullopt;
        if (*name == periodic::name_of(OrbitMeasure::frequency)) {
            measure = OrbitMeasure::frequency;
            return std::nullopt;
        }
        for (const OrbitMeasure one : amplitudes) {
            const std::string ending = "." + periodic::name_of(one);
            if (!name->ends_with(ending)) continue;
            measure = one;
            return coordinate_named(name->substr(0, name->size() - ending.size()), *plot, job);
        }
        return coordinate_named(*name, *plot, job);
    }
    if (!job.model.system) return std::nullopt;
    // Where an orbit without a section begins is arbitrary; its time is not.
    if (job.model.is(models::Kind::autonomous) && !job.section_plane) return std::nullopt;
    // Not the coordinate that is the same at all points, and an angle only where there is nothing else.
    std::optional<Eigen::Index> choice;
    for (std::size_t i = 0; i < job.model.system->coordinates().size(); ++i) {
        const auto index = static_cast<Eigen::Index>(i);
        if (job.section_plane && job.section_plane->coordinate == index) continue;
        if (!job.model.system->coordinates()[i].angle) return index;
        if (!choice) choice = index;
    }
    return choice;
}

}  // namespace

const FieldTable<ContinuationJob>& continuation_fields() {
    using Json = nlohmann::ordered_json;
    static const FieldTable<ContinuationJob> table = [] {
        FieldTable<ContinuationJob> fields{
            {key("parameter", text(), "The parameter that is followed.").required_always(), read_later<ContinuationJob>,
             [](const ContinuationJob& continuation, const Writing& at) -> Json {
                 return parameter_name(at.job, continuation.options.parameter);
             }},
            {key("range", list(number(), 2, 2, "[lower, upper]"), "Its values; contains the model's own."),
             read_later<ContinuationJob>,
             [](const ContinuationJob& continuation, const Writing&) -> Json {
                 return Json::array({continuation.options.lower, continuation.options.upper});
             }},
            {key("to", number(), "Where the branch ends that starts at the model's own value."),
             read_later<ContinuationJob>, [](const ContinuationJob&, const Writing&) { return left_out(); }},
            refused_field<ContinuationJob>(key("from", anything(), "")
                                               .refuse("a branch starts at the model's own value of the parameter: "
                                                       "\"to\" says where it ends, or \"range\": [lower, upper]")),
            field(key("direction", one_of({1.0, -1.0, 0.0}),
                      "First to larger values (1), to smaller ones (-1), or both ways (0).")
                      .without("to"),
                  &ContinuationJob::options, &Options::direction),
            {key("orbit", whole(0, most_found), "Of the list in orbits.json, where the branch starts; from 0.")
                 .by_default(0),
             read_later<ContinuationJob>,
             [](const ContinuationJob& continuation, const Writing&) -> Json { return continuation.orbit; }},
            {key("step", object(keys_of(step_fields())),
                 "Steps along the branch, relative to the scales and the range."),
             read_step, [](const ContinuationJob& continuation, const Writing& at) {
                 return fields_document(continuation.options, step_fields(), at);
             }}};
        add_fields_of(fields, branch_fields(), &ContinuationJob::options);
        fields.push_back(
            {key("plot", text(),
                 "What branch.svg shows: a coordinate, a measure x.half_range (max, min, mean, rms), "
                 "\"frequency\", or \"time\"."),
             read_later<ContinuationJob>, [](const ContinuationJob& continuation, const Writing& at) -> Json {
                 if (!continuation.plotted)
                     return continuation.measure ? periodic::name_of(*continuation.measure) : "time";
                 const std::string& name = coordinate_name(at.job, *continuation.plotted);
                 return continuation.measure ? name + "." + periodic::name_of(*continuation.measure) : name;
             }});
        return fields;
    }();
    return table;
}

void read_continuation(const ValueReader& value, const Job& job, PeriodicJob& periodic) {
    ContinuationJob continuation;
    periodic::ContinuationOptions& options = continuation.options;
    ObjectReader object(value);
    read_fields(object, continuation_fields(), continuation, job);
    std::optional<Eigen::Index> parameter;
    if (const auto name = object.find("parameter")) {
        const auto text = name->text();
        if (text) parameter = parameter_named(*text, *name, job);
        options.parameter = parameter.value_or(0);
    }
    read_range(object, job, parameter, options);
    if (const auto orbit = object.find("orbit")) {
        // How many a search finds is not known before.
        const std::size_t count = std::max<std::size_t>(periodic.orbits.size(), 1);
        const auto number = orbit->number([&](double x) { return periodic.search || x < static_cast<double>(count); },
                                          fmt::format("below {}, the number of starts", count));
        continuation.orbit = static_cast<std::size_t>(number.value_or(0.0));
    }
    if (const auto period = object.find("maximum_period")) {
        if (!period->refused() && continuation.orbit < periodic.orbits.size() &&
            periodic.orbits[continuation.orbit].period > options.maximum_period)
            period->report(fmt::format("must be at least the period of the orbit it starts at, {}, not {}",
                                       periodic.orbits[continuation.orbit].period, options.maximum_period));
    }
    continuation.plotted = read_plotted(object, job, continuation.measure);
    object.finish();
    periodic.continuation = std::move(continuation);
}

}  // namespace orbid::apps::describe

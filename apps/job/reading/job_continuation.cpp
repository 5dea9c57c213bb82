#include <algorithm>

#include "apps/job/job_parts.hpp"
#include "apps/job/schema/block_fields.hpp"

namespace orbid::apps {

namespace {

/// { "first": 0.01, "smallest": 1e-7, "largest": 0.05 }
void read_step(const ValueReader& value, periodic::ContinuationOptions& options) {
    ObjectReader object(value);
    read_fields(object, describe::step_fields(), options);
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
    object.read("direction", options.direction);
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

/// What branch.svg shows: a coordinate, or "time".
std::optional<Eigen::Index> read_plotted(ObjectReader& object, const Job& job) {
    if (const auto plot = object.find("plot")) {
        const auto name = plot->text();
        if (!name || *name == "time" || !job.model.system) return std::nullopt;
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

void read_continuation(const ValueReader& value, const Job& job, PeriodicJob& periodic) {
    ContinuationJob continuation;
    periodic::ContinuationOptions& options = continuation.options;
    ObjectReader object(value);
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
    if (const auto step = object.find("step")) read_step(*step, options);
    read_fields(object, describe::branch_fields(), options);
    if (const auto period = object.find("maximum_period")) {
        if (!period->refused() && continuation.orbit < periodic.orbits.size() &&
            periodic.orbits[continuation.orbit].period > options.maximum_period)
            period->report(fmt::format("must be at least the period of the orbit it starts at, {}, not {}",
                                       periodic.orbits[continuation.orbit].period, options.maximum_period));
    }
    continuation.plotted = read_plotted(object, job);
    object.finish();
    periodic.continuation = std::move(continuation);
}

}  // namespace orbid::apps

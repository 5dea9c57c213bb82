#include <algorithm>
#include <cmath>
#include <limits>

#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/estimate_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/data_job.hpp"

namespace orbid::apps::describe {

namespace {

using estimator::FreeParameter;
using Json = nlohmann::ordered_json;

constexpr double infinity = std::numeric_limits<double>::infinity();

/// Scales whose ends are never reached: the end of a domain may be one although no value.
bool is_logarithmic(estimator::Scale scale) {
    return scale == estimator::Scale::log || scale == estimator::Scale::log10;
}

/// [lower, upper], null = none.
void read_bounds(const ValueReader& value, const Job& job, FreeParameterJob& parameter) {
    const models::Parameter& entry = job.model.parameter(parameter.parameter);
    FreeParameter& free = parameter.value;
    const auto items = value.items();
    if (items.size() != 2) return;
    const auto bound = [](const ValueReader& item, double none) {
        return item.is(JsonValue::Kind::null) ? none : item.number().value_or(none);
    };
    const bool no_lower = items[0].is(JsonValue::Kind::null);
    const double lower = bound(items[0], free.lower);
    const double upper = bound(items[1], infinity);
    if (!(lower < upper)) {
        value.report(fmt::format("lower bound {} must be below the upper bound {}", lower, upper));
        return;
    }
    const bool log_scale = is_logarithmic(free.scale);
    // On a log or logit scale the bound 0 is never reached.
    const bool open_zero = log_scale || (free.scale == estimator::Scale::logit && lower == 0.0);
    const bool allowed = no_lower || (open_zero ? lower >= 0.0 : models::contains(entry.domain, lower));
    if (!allowed) {
        items[0].report(fmt::format("lower bound {} lies outside the domain of {}: must be {}", lower, entry.name,
                                    log_scale ? ">= 0 on a log scale" : models::rule(entry.domain)));
        return;
    }
    free.lower = lower;
    free.upper = upper;
}

const FieldTable<FreeParameter>& tie_fields() {
    static const FieldTable<FreeParameter> table{
        open_field(key("to", text(), "An estimated parameter.").required_always(), &FreeParameter::tied_to),
        field(key("factor", other_than(0.0), "This one is so many times that one."), &FreeParameter::tie_factor)};
    return table;
}

/// A tied parameter has only its tie.
const FieldTable<FreeParameterJob>& free_parameter_fields() {
    static const FieldTable<FreeParameterJob> table{
        open_field(key("start", number(), "Where the estimate begins; the model's value unless given.").without("tied"),
                   &FreeParameterJob::value, &FreeParameter::start)
            .written_after("tied"),
        Field<FreeParameterJob>{
            key("scale", choice(scale_names),
                "On which it is estimated; \"log\" for positive parameters, else \"linear\", unless given.")
                .without("tied"),
            [](const ValueReader& value, const Job& job, FreeParameterJob& free) {
                value.choose(scale_names, free.value.scale);
                identification::set_default_bounds(job.model.parameter(free.parameter), free.value);
            },
            [](const FreeParameterJob& free, const Writing&) -> Json { return name_of(free.value.scale, scale_names); }}
            .written_after("tied"),
        Field<FreeParameterJob>{
            key("bounds", bounds(), "[lower, upper], inclusive; null stands for no bound.").without("tied"),
            read_bounds,
            [](const FreeParameterJob& free, const Writing&) {
                return bounds_document(free.value.lower, free.value.upper);
            }}
            .written_after("tied"),
        Field<FreeParameterJob>{
            key("prior", prior(), "What is known before the data.").by_default("flat").without("tied"),
            [](const ValueReader& value, const Job&, FreeParameterJob& free) {
                free.value.prior = read_prior(value).value_or(estimator::Prior{});
            },
            [](const FreeParameterJob& free, const Writing&) { return prior_document(free.value.prior); }}
            .written_after("tied"),
        Field<FreeParameterJob>{key("tied", text("the name of an estimated parameter") | object(keys_of(tie_fields())),
                                    "Follows another parameter."),
                                [](const ValueReader& value, const Job& job, FreeParameterJob& free) {
                                    read_short_or_object(value, "to", tie_fields(), free.value, job);
                                },
                                [](const FreeParameterJob& free, const Writing& at) {
                                    return fields_document(free.value, tie_fields(), at);
                                }}
            .written_if([](const FreeParameterJob& free) { return !free.value.tied_to.empty(); })};
    return table;
}

/// Checks a tie against all parameters; takes start and scale from the parameter it follows.
void resolve_tie(const ValueReader& at, const Job& job, const EstimateJob& estimate, FreeParameterJob& free) {
    FreeParameter& value = free.value;
    const auto& all = estimate.parameters;
    const auto leader = std::find_if(all.begin(), all.end(),
                                     [&](const FreeParameterJob& other) { return other.value.name == value.tied_to; });
    if (value.tied_to == value.name) {
        at.report(fmt::format("{} is tied to itself", value.name));
        return;
    }
    if (leader == all.end()) {
        std::vector<std::string> others;
        for (const FreeParameterJob& other : all)
            if (other.value.name != value.name) others.push_back(other.value.name);
        at.report(fmt::format("\"{}\" is no estimated parameter{}", value.tied_to, suggestion(value.tied_to, others)));
        return;
    }
    if (!leader->value.tied_to.empty()) {
        at.report(
            fmt::format("{} is tied to {} itself: tie both to that one", leader->value.name, leader->value.tied_to));
        return;
    }
    for (const DataJob& data : job.data) {
        if (!data.has_own(leader->parameter) || data.has_own(free.parameter)) continue;
        at.report(fmt::format("{} is free in \"{}\": list {} in \"free\" there too", leader->value.name, data.name,
                              value.name));
    }
    value.start = value.tie_factor * leader->value.start;
    const models::Parameter& entry = job.model.parameter(free.parameter);
    if (!models::contains(entry.domain, value.start))
        at.report(fmt::format("start {} of {} ({}), {} times that of {}: must be {}", value.start, value.name,
                              entry.description, value.tie_factor, leader->value.name, models::rule(entry.domain)));
    // Zero is no value of a positive parameter, and no bound that the followed one reaches on a log scale.
    value.scale = leader->value.scale;
    value.lower = entry.domain == models::Domain::real ? -infinity : 0.0;
}

void check_start(const ValueReader& at, const models::Parameter& entry, const FreeParameter& free) {
    if (!models::contains(entry.domain, free.start)) {
        at.report(fmt::format("start {} of {} ({}): must be {}", free.start, entry.name, entry.description,
                              models::rule(entry.domain)));
    } else if (is_logarithmic(free.scale) && !(free.start > 0.0)) {
        at.report(fmt::format("start {} of {} has no logarithm: use \"scale\": \"linear\", or a start > 0", free.start,
                              entry.name));
    } else if (free.scale == estimator::Scale::logit && !(free.lower < free.start && free.start < free.upper)) {
        at.report(fmt::format("start {} of {} must lie inside its bounds ({}, {}) on a logit scale", free.start,
                              entry.name, free.lower, free.upper));
    } else if (!(free.lower <= free.start && free.start <= free.upper)) {
        at.report(fmt::format("start {} of {} lies outside its bounds [{}, {}]", free.start, entry.name, free.lower,
                              free.upper));
    } else if (!std::isfinite(estimator::negative_log_density(free.prior, free.start))) {
        at.report(fmt::format("start {} of {} has no density under its prior", free.start, entry.name));
    }
}

/// A tie is resolved when all parameters are read.
FreeParameterJob read_free(const ValueReader& value, Eigen::Index index, const Job& job) {
    const models::Parameter& entry = job.model.parameter(index);
    FreeParameterJob result{index, identification::free_parameter(entry, job.model.values[index])};
    FreeParameter& free = result.value;
    const std::size_t problems_before = value.problem_count();
    read_object(value, free_parameter_fields(), result, job);
    ObjectReader object(value);
    if (object.find("tied")) return result;
    const auto scale = object.find("scale");
    if (scale && free.scale == estimator::Scale::logit && !(std::isfinite(free.lower) && std::isfinite(free.upper)))
        scale->report(fmt::format("a logit scale needs finite \"bounds\"; they are [{}, {}]", free.lower, free.upper));
    // What is wrong already would only be reported a second time in other words.
    if (value.sound() && value.problem_count() == problems_before)
        check_start(object.find("start").value_or(value), entry, free);
    return result;
}

void check_experiments(const ValueReader& at, const Job& job, const EstimateJob& estimate) {
    const auto names = parameter_names(job);
    const auto is_free = [&](Eigen::Index index) {
        return std::any_of(estimate.parameters.begin(), estimate.parameters.end(),
                           [&](const FreeParameterJob& free) { return free.parameter == index; });
    };
    for (const DataJob& data : job.data) {
        for (const Eigen::Index index : data.free) {
            if (is_free(index)) continue;
            at.report(fmt::format("{} is free in \"{}\", but has no entry in \"parameters\" (its start and bounds)",
                                  names[static_cast<std::size_t>(index)], data.name));
        }
        for (const ParameterValue& value : data.parameters) {
            if (data.has_own(value.parameter) || data.simulation || !is_free(value.parameter)) continue;
            at.report(fmt::format("{} is estimated, and given for \"{}\": list it in \"free\" there, or leave one out",
                                  names[static_cast<std::size_t>(value.parameter)], data.name));
        }
    }
}

void read_parameters(const ValueReader& value, const Job& job, EstimateJob& estimate) {
    for (const auto& [name, member] : value.members()) {
        const auto index = parameter_named(name, member, job);
        if (index) estimate.parameters.push_back(read_free(member, *index, job));
    }
    for (const auto& [name, member] : value.members()) {
        for (FreeParameterJob& free : estimate.parameters) {
            if (free.value.name != name || free.value.tied_to.empty()) continue;
            resolve_tie(ObjectReader(member).find("tied").value_or(member), job, estimate, free);
        }
    }
    if (job.model.system) check_experiments(value, job, estimate);
}

}  // namespace

ValueSchema bounds() {
    return list(number() | null(), 2, 2, "[lower, upper]; null stands for no bound");
}

Field<EstimateJob> parameters_field() {
    const ValueSchema parameter = named("free_parameter", object(keys_of(free_parameter_fields())));
    return {key("parameters", entries(parameter, "a parameter of the model"),
                "The free ones; {} for error scales and initial states alone.")
                .required_always(),
            read_parameters, [](const EstimateJob& estimate, const Writing& at) {
                Json object = Json::object();
                for (const FreeParameterJob& free : estimate.parameters)
                    object[free.value.name] = fields_document(free, free_parameter_fields(), at);
                return object;
            }};
}

}  // namespace orbid::apps::describe

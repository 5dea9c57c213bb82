#include <cmath>

#include "apps/job/blocks/block_fields.hpp"
#include "apps/job/blocks/estimate_fields.hpp"
#include "apps/job/blocks/job_schema.hpp"
#include "apps/job/data_job.hpp"

namespace orbid::apps::describe {

namespace {

using Json = nlohmann::ordered_json;
using Initial = InitialValueJob;

void read_initial_bounds(const ValueReader& value, const Job&, Initial& initial) {
    const auto items = value.items();
    if (items.size() == 2) {
        if (!items[0].is(JsonValue::Kind::null)) initial.lower = items[0].number().value_or(initial.lower);
        if (!items[1].is(JsonValue::Kind::null)) initial.upper = items[1].number().value_or(initial.upper);
        if (!(initial.lower < initial.upper))
            value.report(fmt::format("lower bound {} must be below the upper bound {}", initial.lower, initial.upper));
    }
    if (initial.scale == estimator::Scale::log && initial.lower < 0.0)
        value.report(fmt::format("lower bound {} must be >= 0 on a log scale", initial.lower));
}

/// A coordinate's value at the beginning: held, or estimated. Beside a value the other keys have been refused.
const FieldTable<Initial>& initial_value_fields() {
    const auto is_parameter = [](const Initial& initial) { return initial.is_parameter(); };
    static const FieldTable<Initial> table{
        {key("value", number(), "Held at this value."),
         [](const ValueReader& value, const Job&, Initial& initial) {
             initial.estimate = false;
             initial.value = value.number().value_or(0.0);
         },
         [](const Initial& initial, const Writing&) {
             return initial.estimate ? left_out() : Json(initial.value.value());
         }},
        {key("start", number(), "Of the estimate; from the data unless given.").without("value"),
         [](const ValueReader& value, const Job&, Initial& initial) {
             if (initial.estimate) initial.value = value.number();
         },
         [](const Initial& initial, const Writing&) { return initial.value ? Json(*initial.value) : left_out(); }},
        {key("prior", prior(), "What is known of it.").by_default("flat").without("value"),
         [](const ValueReader& value, const Job&, Initial& initial) {
             initial.prior = read_prior(value).value_or(estimator::Prior{});
             identification::set_default_scale(initial);
         },
         [](const Initial& initial, const Writing&) { return prior_document(initial.prior); }},
        word_field(
            key("scale", {}, "On which it is estimated; \"log\" by default where its prior is one of positive numbers.")
                .without("value"),
            {{estimator::Scale::linear, "linear"}, {estimator::Scale::log, "log"}}, &Initial::scale)
            .with_rule([](const ValueReader&, const Job&, Initial& initial) {
                if (initial.scale == estimator::Scale::log) initial.lower = 0.0;
            })
            .written_if(is_parameter),
        Field<Initial>{
            key("bounds", bounds(), "[lower, upper]; null stands for no bound.").without("value"), read_initial_bounds,
            [](const Initial& initial, const Writing&) { return bounds_document(initial.lower, initial.upper); }}
            .written_if(is_parameter)};
    return table;
}

void check_start(const ValueReader& start, const Initial& initial) {
    if (!initial.estimate || !initial.value) return;
    if (initial.scale == estimator::Scale::log && !(*initial.value > 0.0)) {
        start.report(fmt::format("start {} has no logarithm: give a start > 0", *initial.value));
    } else if (!(initial.lower <= *initial.value && *initial.value <= initial.upper)) {
        start.report(
            fmt::format("start {} lies outside the bounds [{}, {}]", *initial.value, initial.lower, initial.upper));
    } else if (!std::isfinite(estimator::negative_log_density(initial.prior, *initial.value))) {
        start.report(fmt::format("start {} has no density under its prior", *initial.value));
    }
}

/// "estimate", or an object.
Initial read_initial_value(const ValueReader& value) {
    Initial initial;
    if (!value.is(JsonValue::Kind::object)) return initial;
    ObjectReader object(value);
    read_fields(object, initial_value_fields(), initial);
    if (const auto start = object.find("start")) check_start(*start, initial);
    object.finish();
    return initial;
}

void read_initial_state(const ValueReader& value, const Job& job, DataJob& data) {
    if (data.sampling() == orbits::Series::Sampling::section)
        value.report("holds for samples; a section series has no free initial state in this version");
    for (const auto& [name, member] : value.members()) {
        const auto initial = read_initial_value(member);
        if (const auto index = coordinate_named(name, member, job))
            data.initial_state[static_cast<std::size_t>(*index)] = initial;
    }
}

Json initial_state_document(const DataJob& data, const Writing& at) {
    if (data.sampling() == orbits::Series::Sampling::section || data.initial_state.empty()) return left_out();
    Json object = Json::object();
    for (std::size_t i = 0; i < data.initial_state.size(); ++i)
        object[coordinate_name(at.job, static_cast<Eigen::Index>(i))] =
            fields_document(data.initial_state[i], initial_value_fields());
    return object;
}

}  // namespace

Field<DataJob> initial_state_field() {
    return {key("initial_state",
                entries(choice({"estimate"}) | object(keys_of(initial_value_fields())), "a coordinate of the model"),
                "Samples: where the state at the beginning of each segment comes from."),
            read_initial_state, initial_state_document};
}

}  // namespace orbid::apps::describe

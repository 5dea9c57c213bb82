#pragma once

#include "apps/job/blocks/estimate_fields.hpp"

namespace orbid::apps::describe {

// Numbers that may be estimated: scales and shapes of errors.

/// A number of this form, "estimate", or { "estimate": { "start", "prior" } }.
[[nodiscard]] inline ValueSchema number_or_estimate(const ValueSchema& number) {
    const ValueSchema inner = object({key("start", number, "Where the estimate begins."),
                                      key("prior", prior(), "What is known of it.").by_default("flat")});
    return number | choice({"estimate"}) |
           object({key("estimate", inner, "Estimated, with more said of it.").required_always()});
}

/// { "start", "prior" }. `Number`: estimator::ErrorScale or ErrorParameter.
template <class Number>
void read_estimated(const ValueReader& value, Number& target) {
    target.estimate = true;
    ObjectReader object(value);
    object.read("start", target.value);
    if (const auto entry = object.find("prior")) target.prior = read_prior(*entry).value_or(estimator::Prior{});
    object.finish();
}

/// Where no start is given, `target` keeps its value.
template <class Number>
void read_number_or_estimate(const ValueReader& value, Number& target) {
    target.estimate = !value.is(JsonValue::Kind::number);
    if (!target.estimate) return value.read(target.value);
    if (value.is(JsonValue::Kind::string)) (void)value.choice({"estimate"});
    if (!value.is(JsonValue::Kind::object)) return;
    ObjectReader object(value);
    if (const auto inner = object.find("estimate")) read_estimated(*inner, target);
    object.finish();
}

[[nodiscard]] inline nlohmann::ordered_json start_and_prior(double start, bool has_start,
                                                            const estimator::Prior& prior) {
    nlohmann::ordered_json options = nlohmann::ordered_json::object();
    if (has_start) options["start"] = start;
    options["prior"] = prior_document(prior);
    return options;
}

/// <= 0 while estimated: from the residuals.
[[nodiscard]] inline nlohmann::ordered_json estimated_scale_document(const estimator::ErrorScale& scale) {
    return start_and_prior(scale.value, scale.value > 0.0, scale.prior);
}

[[nodiscard]] inline nlohmann::ordered_json number_or_estimate_document(const estimator::ErrorScale& scale) {
    return scale.estimate ? nlohmann::ordered_json{{"estimate", estimated_scale_document(scale)}}
                          : nlohmann::ordered_json(scale.value);
}

[[nodiscard]] inline nlohmann::ordered_json number_or_estimate_document(const estimator::ErrorParameter& shape) {
    return shape.estimate ? nlohmann::ordered_json{{"estimate", start_and_prior(shape.value, true, shape.prior)}}
                          : nlohmann::ordered_json(shape.value);
}

}  // namespace orbid::apps::describe

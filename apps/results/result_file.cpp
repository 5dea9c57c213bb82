#include "apps/results/result_file.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "apps/documents/json_text.hpp"
#include "apps/results/cycle_file.hpp"
#include "apps/results/lost_records.hpp"
#include "apps/results/trust_verdict.hpp"

namespace orbid::apps {
namespace {

using Json = nlohmann::ordered_json;

std::optional<double> find(const std::map<std::string, double>& values, const std::string& name) {
    const auto found = values.find(name);
    return found == values.end() ? std::nullopt : std::optional<double>(found->second);
}

Json interval_json(double lower, double upper) {
    return std::isfinite(lower) && std::isfinite(upper) ? Json::array({lower, upper}) : Json(nullptr);
}

Json estimated_json(const estimator::Estimated& x, const std::map<std::string, double>& references) {
    const auto reference = find(references, x.name);
    Json out;
    out["value"] = x.value;
    out["sd"] = x.sd;
    out["interval95"] = interval_json(x.lower95, x.upper95);
    out["interval_method"] = name(x.interval_method);
    out["one_sided"] = json_or_null(name(x.limit));
    out["start"] = x.start;
    out["reference"] = json_or_null(reference);
    out["relative_deviation"] = relative_deviation(x.value, reference);
    out["unit"] = x.unit;
    out["at_bound"] = json_or_null(name(x.at_bound));
    out["laplace_sd"] = x.laplace_sd;
    out["data_share"] = x.data_share;
    out["bias"] = x.bias;
    return out;
}

Json parameters_json(const estimator::Estimate& estimate, const std::map<std::string, double>& references,
                     const identification::StructuralReport& structure) {
    Json out = estimated_list(estimate.parameters, references);
    for (const estimator::Estimated& x : estimate.parameters)
        if (const std::string why = structure.why_held(x.name); !why.empty()) out[x.name]["held"] = why;
    for (std::size_t i = 0; i < estimate.parameters.size(); ++i) {
        const auto index = static_cast<Eigen::Index>(i);
        const bool known = index < estimate.hessian_ratio.size();
        // Not a number where unknown: null.
        out[estimate.parameters[i].name]["hessian_ratio"] = known ? Json(estimate.hessian_ratio[index]) : Json(nullptr);
    }
    return out;
}

Json covariance_json(const estimator::EstimatedCovariance& covariance) {
    return {{"groups", covariance.groups},
            {"matrix", json_rows(covariance.value)},
            {"uncertainty", json_rows(covariance.uncertainty)}};
}

/// `sd` is always a standard deviation in the data's unit: of a factor group it is the rms of the raw residuals.
/// `interval95` belongs to what was estimated: the factor of such a group, the sd of the others.
Json scale_json(const estimator::EstimatedScale& scale) {
    Json out;
    out["sd"] = scale.factor ? scale.rms : scale.value;
    out["factor"] = scale.factor ? Json(scale.value) : Json(nullptr);
    out["uncertainty"] = scale.uncertainty;
    out["unit"] = scale.unit;
    out["count"] = scale.count;
    out["estimated"] = scale.estimated;
    out["rms"] = scale.rms;
    out["distribution"] = scale.distribution;
    out["interval95"] = interval_json(scale.lower95, scale.upper95);
    for (const estimator::Estimated& parameter : scale.shape)
        out[parameter.name] = {{"value", parameter.value},
                               {"uncertainty", parameter.sd},
                               {"interval95", interval_json(parameter.lower95, parameter.upper95)},
                               {"start", parameter.start}};
    out["lag1"] = scale.lag1;
    out["correlation_records"] = scale.correlation_records;
    out["effective_count"] = scale.effective_count;
    return out;
}

Json state_value_json(const InitialState::Value& value) {
    return {{"value", value.value}, {"sd", value.sd}, {"unit", value.unit}, {"estimated", value.estimated}};
}

Json initial_state_json(const InitialState& state) {
    Json out;
    out["experiment"] = state.experiment;
    out["segment"] = state.segment;
    for (const auto& value : state.values)
        out["state"][value.coordinate] = state_value_json(value);
    return out;
}

Json steady_state_json(const SteadyState& state) {
    Json out;
    out["experiment"] = state.experiment;
    out["segment"] = state.segment;
    out["used"] = state.used;
    // Motions of a branch have neither.
    if (!state.phase.coordinate.empty()) {
        out["phase"] = state_value_json(state.phase);
        out["offset"] = Json::object();
    }
    for (const auto& offset : state.offsets)
        out["offset"][offset.coordinate] = state_value_json(offset);
    out["status"] = periodic::name(state.orbit.status);
    const bool solved = state.orbit.status == periodic::OrbitStatus::converged;
    out["time"] = solved ? Json(state.orbit.time) : Json(nullptr);
    out["points"] = solved ? json_rows(state.orbit.points.transpose()) : Json::array();
    out["multipliers"] = solved ? detail::complex_pairs(state.orbit.multipliers) : Json::array();
    return out;
}

Json prediction_json(const Prediction& prediction) {
    Json out;
    out["experiment"] = prediction.experiment;
    out["segment"] = prediction.segment;
    out["rms"] = Json::object();
    for (const auto& [coordinate, rms] : prediction.rms)
        out["rms"][coordinate] = rms;
    out["normalised_rms"] = prediction.normalised_rms;
    out["fitted"] = prediction.fitted;
    return out;
}

Json structural_json(const identification::StructuralReport& structure) {
    Json out;
    out["examined"] = structure.examined;
    out["reason"] = json_or_null(structure.reason);
    out["directions"] = json_list(structure.directions, [](const auto& direction) -> Json {
        return {{"kind", identification::name(direction.kind)},
                {"unknowns", direction.unknowns},
                {"components", direction.components},
                {"held", direction.held},
                {"text", direction.text}};
    });
    out["signs"] = structure.signs;
    return out;
}

Json identifiability_json(const estimator::Estimate& estimate, const identification::StructuralReport& structure) {
    Json out;
    out["structural"] = structural_json(structure);
    out["singular_values"] = json_list(estimate.singular_values);
    out["null_directions"] = json_list(estimate.null_directions, [&](const auto& direction) {
        Json named = Json::object();
        for (const auto& [name, component] : named_components(direction, estimate.parameters))
            named[name] = component;
        return named;
    });
    out["told"] =
        json_list(estimate.null_directions, [](const auto& direction) { return json_or_null(direction.told); });
    out["sloppy_directions"] = json_list(estimate.sloppy_directions, [&](const auto& direction) -> Json {
        Json exponents = Json::object();
        for (std::size_t i = 0; i < estimate.parameters.size(); ++i)
            if (const double power = direction.components[static_cast<Eigen::Index>(i)]; power != 0.0)
                exponents[estimate.parameters[i].name] = power;
        return {{"exponents", exponents}, {"sd_of_logarithm", direction.sd}, {"told", json_or_null(direction.told)}};
    });
    out["trust_normal"] = estimate.trust_normal;
    out["distrust"] = json_or_null(estimate.distrust);
    out["effective_count"] = estimate.effective_count;
    return out;
}

Json step_json(const estimator::StepRecord& step) {
    return {{"round", step.round}, {"block", name(step.block)}, {"accepted", step.accepted},  {"before", step.before},
            {"after", step.after}, {"damping", step.damping},   {"reason", name(step.reason)}};
}

Json orbits_json(const ResultContext& context) {
    Json out;
    out["found"] = Json::object();
    for (const auto& [period, count] : context.orbits_found)
        out["found"][std::to_string(period)] = count;
    out["missing"] = context.orbits_missing;
    return out;
}

Json data_json(const ResultContext& context) {
    Json out;
    out["points"] = context.data_points;
    out["segments"] = context.data_segments;
    out["captured"] = json_list(context.captured, [](const Capture& x) -> Json {
        return {{"experiment", x.experiment}, {"trajectory", x.trajectory}, {"section", x.section}, {"what", x.what}};
    });
    return out;
}

}  // namespace

Json estimated_list(const std::vector<estimator::Estimated>& list, const std::map<std::string, double>& references) {
    Json out = Json::object();
    for (const auto& x : list)
        out[x.name] = estimated_json(x, references);
    return out;
}

std::string csv_cell(const std::string& text) {
    if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
    std::string out = "\"";
    for (const char c : text)
        out += c == '"' ? "\"\"" : std::string(1, c);
    return out + '"';
}

double relative_deviation(double value, const std::optional<double>& reference) {
    return reference && *reference != 0.0 ? (value - *reference) / *reference
                                          : std::numeric_limits<double>::quiet_NaN();
}

std::vector<std::pair<std::string, double>> named_components(const estimator::NullDirection& direction,
                                                             const std::vector<estimator::Estimated>& parameters) {
    constexpr double rounding = 1e-6;
    std::vector<std::pair<std::string, double>> out;
    if (direction.components.size() == 0) return out;
    const double largest = direction.components.cwiseAbs().maxCoeff();
    for (Eigen::Index i = 0; i < direction.components.size(); ++i)
        if (std::abs(direction.components[i]) > rounding * largest)
            out.emplace_back(parameters.at(static_cast<std::size_t>(i)).name, direction.components[i]);
    // Compared in steps of the rounding: equal sizes keep the parameters' order, so that the bytes are stable.
    const auto size = [largest](const std::pair<std::string, double>& named) {
        return std::llround(std::abs(named.second) / (rounding * largest));
    };
    std::stable_sort(out.begin(), out.end(), [size](const auto& a, const auto& b) { return size(a) > size(b); });
    return out;
}

std::string result_text(const estimator::Estimate& estimate, const ResultContext& context) {
    Json out;
    out["format"] = "orbid-result/1";
    out["status"] = estimator::name(estimate.status);
    const std::string lost = lost_records(estimate.counts, context.steady_states);
    out["message"] = estimate.message + (estimate.message.empty() || lost.empty() ? "" : "; ") + lost;
    const TrustVerdict verdict = trust_verdict(estimate, context);
    out["verdict"] = {{"trust", name(verdict.trust)}, {"line", verdict.line()}, {"because", verdict.because}};
    if (!context.evaluated.empty()) out["model"]["evaluated"] = context.evaluated;
    out["parameters"] = parameters_json(estimate, context.reference, context.structure);
    out["derived"] = estimated_list(estimate.derived, context.reference);
    out["errors"] = Json::object();
    for (const auto& scale : estimate.scales)
        out["errors"][scale.group] = scale_json(scale);
    out["covariances"] = json_list(estimate.covariances, covariance_json);
    out["initial_states"] = json_list(context.initial_states, initial_state_json);
    if (!context.steady_states.empty()) out["steady_states"] = json_list(context.steady_states, steady_state_json);
    out["prediction"] = json_list(context.predictions, prediction_json);
    const Json names = json_list(estimate.parameters, &estimator::Estimated::name);
    out["correlation"] = {{"names", names}, {"matrix", json_rows(estimate.correlation)}};
    out["covariance"] = {{"names", names}, {"matrix", json_rows(estimate.covariance)}};
    out["identifiability"] = identifiability_json(estimate, context.structure);
    out["residuals"] = counts_json(estimate.counts);
    add_strategy(context.strategy, context.reference, out);
    out["objective"] = estimate.objective;
    out["log_likelihood"] = estimate.log_likelihood;
    out["log_evidence"] = evidence_json(context.evidence);
    out["degrees_of_freedom"] = estimate.degrees_of_freedom;
    out["iterations"] = estimate.iterations;
    out["evaluations"] = estimate.evaluations;
    out["rounds"] = estimate.rounds;
    add_posterior(context.posterior, out);
    out["orbits"] = orbits_json(context);
    out["data"] = data_json(context);
    out["history"] = json_list(estimate.history, step_json);
    if (!context.fingerprint.sha256.empty()) out["fingerprint"] = Json::parse(to_text(context.fingerprint));
    return json_text(out);
}

}  // namespace orbid::apps

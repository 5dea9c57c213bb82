#include "apps/results/strategy_results.hpp"

#include <cmath>

#include <fmt/format.h>

#include "apps/documents/json_text.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;

Json stage_json(const StageResult& stage, const std::map<std::string, double>& references) {
    Json out;
    out["stage"] = stage.stage;
    out["status"] = identification::status_name(stage.status);
    out["message"] = stage.message;
    out["chosen"] = stage.chosen;
    out["parameters"] = estimated_list(stage.parameters, references);
    out["derived"] = estimated_list(stage.derived, references);
    out["residuals"] = counts_json(stage.counts);
    out["objective"] = stage.objective;
    out["iterations"] = stage.iterations;
    out["evaluations"] = stage.evaluations;
    return out;
}

Json matching_json(const MatchingResult& matching) {
    Json out;
    out["experiment"] = matching.experiment;
    out["interval"] = matching.interval;
    out["intervals"] = matching.intervals;
    out["large_defects"] = matching.large;
    out["expected_share"] = matching.expected;
    for (const auto& coordinate : matching.coordinates)
        out["coordinates"][coordinate.name] = {
            {"sd", coordinate.sd}, {"rms", coordinate.rms}, {"typical", coordinate.typical}, {"unit", coordinate.unit}};
    for (const auto& one : matching.diffusion)
        out["diffusion"][one.name] = {{"value", one.value},
                                      {"sd", one.value > 0.0 ? Json(one.sd) : Json(nullptr)},
                                      {"interval95", one.value > 0.0 ? Json{one.lower95, one.upper95} : Json(nullptr)},
                                      {"unit", one.unit},
                                      {"at_bound", one.value > 0.0 ? Json(nullptr) : Json("lower")},
                                      {"least", one.least}};
    out["looser_shift_in_sds"] = Json::object();
    for (const auto& [name, sds] : matching.shift)
        out["looser_shift_in_sds"][name] = sds;
    out["warnings"] = matching.warnings;
    return out;
}

Json alternative_json(const AlternativeResult& alternative, const std::map<std::string, double>& references) {
    Json out;
    out["model"] = alternative.name;
    out["status"] = identification::status_name(alternative.status);
    out["message"] = alternative.message;
    out["parameters"] = estimated_list(alternative.parameters, references);
    out["ln_bayes_factor"] = evidence_json(alternative.ln_bayes_factor);
    const auto& factor = alternative.ln_bayes_factor.value;
    out["ln_bayes_factor_uncertainty"] = factor ? Json(alternative.ln_bayes_factor_uncertainty) : Json(nullptr);
    out["verdict"] = factor ? Json(in_words(*factor)) : Json(nullptr);
    out["objective_difference"] = alternative.objective_difference;
    out["held_out"] = evidence_json(alternative.score);
    out["held_out"]["sd"] = alternative.score_error;
    out["large_defects"] = json_or_null(alternative.large_defects);
    out["used"] = alternative.used;
    return out;
}

Json criticism_json(const CriticismResult& criticism, const std::map<std::string, double>& references) {
    Json out;
    out["model"] = criticism.model;
    out["stage"] = criticism.stage;
    out["large_defects"] = json_or_null(criticism.large_defects);
    out["intervals"] = criticism.intervals;
    out["held_out"] = evidence_json(criticism.score);
    out["held_out"]["sd"] = criticism.score_error;
    out["alternatives"] = json_list(criticism.alternatives, [&](const AlternativeResult& alternative) {
        return alternative_json(alternative, references);
    });
    return out;
}

}  // namespace

std::string in_words(double ln_bayes_factor) {
    const double size = std::abs(ln_bayes_factor);
    std::string strength = "very strongly";
    if (size < 1.0) return "the data hardly tell them apart";
    if (size < 3.0)
        strength = "positively";
    else if (size < 5.0)
        strength = "strongly";
    return fmt::format("{} supported: {}", strength, ln_bayes_factor > 0.0 ? "the job's model" : "this one");
}

Json counts_json(const std::vector<estimator::ResidualCount>& counts) {
    return json_list(counts, [](const estimator::ResidualCount& x) -> Json {
        return {{"type", x.type},         {"used", x.used},   {"lost", x.lost},
                {"rejected", x.rejected}, {"added", x.added}, {"unused", x.unused}};
    });
}

void add_strategy(const StrategyResults& results, const std::map<std::string, double>& references, Json& result) {
    if (!results.stages.empty())
        result["stages"] =
            json_list(results.stages, [&](const StageResult& stage) { return stage_json(stage, references); });
    if (!results.matching.empty()) result["matching"] = json_list(results.matching, matching_json);
    if (results.criticism) result["criticism"] = criticism_json(*results.criticism, references);
}

}  // namespace orbid::apps

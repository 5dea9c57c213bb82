#include "apps/results/strategy_results.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;

Json stage_json(const StageResult& stage, const std::map<std::string, double>& references) {
    Json out;
    out["stage"] = stage.stage;
    out["status"] = stage.status;
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
    out["looser_shift_in_sds"] = Json::object();
    for (const auto& [name, sds] : matching.shift)
        out["looser_shift_in_sds"][name] = sds;
    out["warnings"] = matching.warnings;
    return out;
}

Json alternative_json(const AlternativeResult& alternative, const std::map<std::string, double>& references) {
    Json out;
    out["model"] = alternative.name;
    out["status"] = alternative.status;
    out["message"] = alternative.message;
    out["parameters"] = estimated_list(alternative.parameters, references);
    out["ln_bayes_factor"] = evidence_json(alternative.ln_bayes_factor);
    out["ln_bayes_factor_uncertainty"] =
        alternative.ln_bayes_factor.value ? Json(alternative.ln_bayes_factor_uncertainty) : Json(nullptr);
    out["verdict"] =
        alternative.ln_bayes_factor.value ? Json(in_words(*alternative.ln_bayes_factor.value)) : Json(nullptr);
    out["objective_difference"] = alternative.objective_difference;
    out["held_out"] = evidence_json(alternative.score);
    out["held_out"]["sd"] = alternative.score_error;
    out["large_defects"] = alternative.large_defects ? Json(*alternative.large_defects) : Json(nullptr);
    out["used"] = alternative.used;
    return out;
}

Json criticism_json(const CriticismResult& criticism, const std::map<std::string, double>& references) {
    Json out;
    out["model"] = criticism.model;
    out["stage"] = criticism.stage;
    out["large_defects"] = criticism.large_defects ? Json(*criticism.large_defects) : Json(nullptr);
    out["intervals"] = criticism.intervals;
    out["held_out"] = evidence_json(criticism.score);
    out["held_out"]["sd"] = criticism.score_error;
    out["alternatives"] = Json::array();
    for (const AlternativeResult& alternative : criticism.alternatives)
        out["alternatives"].push_back(alternative_json(alternative, references));
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
    Json out = Json::array();
    for (const auto& count : counts)
        out.push_back({{"type", count.type},
                       {"used", count.used},
                       {"lost", count.lost},
                       {"rejected", count.rejected},
                       {"added", count.added}});
    return out;
}

void add_strategy(const StrategyResults& results, const std::map<std::string, double>& references, Json& result) {
    if (!results.stages.empty()) {
        result["stages"] = Json::array();
        for (const StageResult& stage : results.stages)
            result["stages"].push_back(stage_json(stage, references));
    }
    if (!results.matching.empty()) {
        result["matching"] = Json::array();
        for (const MatchingResult& matching : results.matching)
            result["matching"].push_back(matching_json(matching));
    }
    if (results.criticism) result["criticism"] = criticism_json(*results.criticism, references);
}

}  // namespace orbid::apps

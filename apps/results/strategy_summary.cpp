#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "apps/results/strategy_results.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

std::string known(const LogEvidence& evidence) {
    return evidence.value ? fmt::format("{:+.1f}", *evidence.value) : "";
}

/// The diffusions of process noise, where it is estimated.
std::string noise_summary(const StrategyResults& results) {
    SummaryTable table({left_aligned("experiment"), left_aligned("coordinate"), "diffusion", "±", "95 % from", "to",
                        left_aligned("unit"), left_aligned("")});
    for (const MatchingResult& matching : results.matching)
        for (const auto& one : matching.diffusion) {
            const bool found = one.value > 0.0;
            table.add({matching.experiment, one.name, significant(one.value, 4), found ? significant(one.sd, 2) : "",
                       found ? significant(one.lower95, 3) : "", found ? significant(one.upper95, 3) : "", one.unit,
                       found ? "" : "at its bound: no process noise is found"});
        }
    return titled("Process noise", table.text());
}

}  // namespace

/// Every stage with its numbers, so that their progress can be followed.
std::string stages_summary(const StrategyResults& results) {
    SummaryTable table(
        {left_aligned("stage"), left_aligned("status"), left_aligned("name"), "value", "± sd", left_aligned("")});
    for (const StageResult& stage : results.stages) {
        std::string name = stage.stage;
        std::string status(identification::status_name(stage.status));
        std::string chosen = stage.chosen ? "the result" : "";
        std::vector<estimator::Estimated> list = stage.parameters;
        list.insert(list.end(), stage.derived.begin(), stage.derived.end());
        if (list.empty()) table.add({name, status, "", "", "", chosen});
        for (const auto& x : list) {
            table.add({name, status, x.name, with_digits_of(x.value, x.sd),
                       std::isfinite(x.sd)                                     ? significant(x.sd, 2)
                       : x.interval_method == estimator::IntervalMethod::fixed ? "held"
                                                                               : "undefined",
                       chosen});
            name.clear();
            status.clear();
            chosen.clear();
        }
    }
    return titled("Stages", table.text());
}

std::string matching_summary(const StrategyResults& results) {
    SummaryTable table({left_aligned("experiment"), "interval", "intervals", "large defects",
                        left_aligned("coordinate"), "sd", "rms", "typical", left_aligned("unit")});
    std::string warnings;
    for (const MatchingResult& matching : results.matching) {
        SummaryTable::Row head{matching.experiment, std::to_string(matching.interval),
                               std::to_string(matching.intervals), std::to_string(matching.large)};
        for (const auto& coordinate : matching.coordinates) {
            SummaryTable::Row cells = head;
            cells.insert(cells.end(), {coordinate.name, significant(coordinate.sd, 2), significant(coordinate.rms, 2),
                                       significant(coordinate.typical, 2), coordinate.unit});
            table.add(std::move(cells));
            head.assign(head.size(), "");
        }
        for (const std::string& warning : matching.warnings)
            warnings += fmt::format("  {}: {}\n", matching.experiment, warning);
    }
    return titled("Matching of nodes", table.text()) + warnings + noise_summary(results);
}

std::string criticism_summary(const StrategyResults& results) {
    if (!results.criticism) return {};
    const CriticismResult& criticism = *results.criticism;
    SummaryTable table({left_aligned("model"), left_aligned("status"), "used", "ln evidence for the job's", "objective",
                        "held out", "±", "large defects", left_aligned("")});
    const auto defects = [](const std::optional<std::size_t>& count) { return count ? std::to_string(*count) : ""; };
    table.add({criticism.model, "the job's", "", "", "", known(criticism.score), significant(criticism.score_error, 2),
               defects(criticism.large_defects), ""});
    std::string reasons;
    for (const AlternativeResult& one : criticism.alternatives) {
        table.add({one.name, std::string(identification::status_name(one.status)), std::to_string(one.used),
                   known(one.ln_bayes_factor),
                   std::isfinite(one.objective_difference) ? fmt::format("{:+.1f}", one.objective_difference) : "",
                   known(one.score), significant(one.score_error, 2), defects(one.large_defects),
                   one.ln_bayes_factor.value ? in_words(*one.ln_bayes_factor.value) : ""});
        if (!one.ln_bayes_factor.value)
            reasons += fmt::format("  {}: no evidence: {}\n", one.name, one.ln_bayes_factor.reason);
        if (!one.score.value && !one.score.reason.empty())
            reasons += fmt::format("  {}: no held-out score: {}\n", one.name, one.score.reason);
    }
    if (!criticism.score.value && !criticism.score.reason.empty())
        reasons += fmt::format("  no held-out score: {}\n", criticism.score.reason);
    return titled(fmt::format("Against other models, on the stage {}", criticism.stage), table.text()) + reasons;
}

}  // namespace orbid::apps

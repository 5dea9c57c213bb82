#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "apps/results/counted_noun.hpp"
#include "apps/results/summary_table.hpp"
#include "apps/stored_run/motion_results.hpp"

namespace orbid::apps {

namespace {

using Eigen::Index;
using identification::PredictedQuantities;
using periodic::OrbitMeasure;

std::string band_words(double lower, double upper, double sd) {
    if (!std::isfinite(lower) || !std::isfinite(upper)) return "";
    return fmt::format("[{}, {}]", with_digits_of(lower, sd), with_digits_of(upper, sd));
}

std::string value_words(double value, double sd) {
    if (!std::isfinite(value)) return "";
    if (!(sd > 0.0)) return significant(value, 6);
    return fmt::format("{} ± {}", with_digits_of(value, sd), significant(sd, 2));
}

/// "198 of 200"; nothing by the delta method.
std::string found_words(std::size_t found, std::size_t draws) {
    return draws > 0 ? fmt::format("{} of {}", found, draws) : std::string();
}

std::string stable_words(bool stable, double share) {
    std::string words = stable ? "stable" : "unstable";
    const double agreeing = stable ? share : 1.0 - share;
    if (std::isfinite(share) && agreeing < 1.0) words += fmt::format(" ({:.0f} % of draws)", 100.0 * agreeing);
    return words;
}

std::string unit_words(const std::string& unit) {
    return unit == "1" ? std::string() : unit;
}

std::string marks_table(const MotionPrediction& prediction) {
    SummaryTable table({left_aligned("place"), prediction.parameter, "95 % band", "in draws"});
    for (const auto& one : prediction.branch.marks) {
        std::string name = one.mark.kind == "equilibrium" ? "Hopf point" : one.mark.kind;
        std::replace(name.begin(), name.end(), '_', ' ');
        const double sd = one.parameter.sd(0);
        table.add({name, value_words(one.mark.parameter, sd),
                   band_words(one.parameter.lower95(0), one.parameter.upper95(0), sd),
                   found_words(one.parameter.found, prediction.draws)});
    }
    return table.text();
}

std::string orbits_table(const MotionPrediction& prediction) {
    SummaryTable table({left_aligned("orbit"), left_aligned("at"), left_aligned("stability"), left_aligned("measure"),
                        "value", "95 % band", left_aligned("unit"), "in draws"});
    for (const AskedOrbit& one : prediction.orbits) {
        std::string at;
        for (const auto& [name, value] : one.at)
            at += fmt::format("{}{} = {:.6g}", at.empty() ? "" : ", ", name, value);
        if (at.empty()) at = "the estimate";
        const periodic::PeriodicOrbit& orbit = one.predicted.orbit;
        if (orbit.status != periodic::OrbitStatus::converged) {
            table.add({std::to_string(one.start), at, "no orbit: " + std::string(periodic::name(orbit.status)), "", "",
                       "", "", ""});
            continue;
        }
        const PredictedQuantities& all = one.predicted.quantities;
        std::string start = std::to_string(one.start);
        std::string stability = stable_words(!(all.value(one.predicted.layout.multiplier()) > 1.0), all.stable);
        std::string found = found_words(all.found, prediction.draws);
        for (std::size_t i = 0; i < prediction.quantities.size(); ++i) {
            const std::string& name = prediction.quantities[i];
            const auto index = static_cast<Index>(i);
            const bool shown = name.ends_with(".half_range") || name == "frequency" || name == "multiplier";
            if (!shown || !std::isfinite(all.value(index))) continue;
            table.add({start, at, stability, name, value_words(all.value(index), all.sd(index)),
                       band_words(all.lower95(index), all.upper95(index), all.sd(index)),
                       unit_words(prediction.units[i]), found});
            start = at = stability = found = "";
        }
    }
    return table.text();
}

std::string measured_table(const MotionPrediction& prediction) {
    SummaryTable table({left_aligned("motion"), left_aligned("measure"), "measured", "predicted", "95 % band",
                        left_aligned("inside"), left_aligned("with errors"), "error", left_aligned("unit"),
                        left_aligned("orbit"), "in draws"});
    std::string last;
    for (const ComparedMeasure& one : prediction.compared) {
        const bool known = std::isfinite(one.lower95);
        const bool predicted = std::isfinite(one.predicted);
        const auto answer = [](bool yes) { return std::string(yes ? "yes" : "no"); };
        table.add({one.motion == last ? "" : one.motion, one.name, significant(one.observed, 5),
                   predicted ? value_words(one.predicted, one.sd) : "no orbit",
                   band_words(one.lower95, one.upper95, one.sd), known ? answer(one.inside()) : "",
                   known && std::isfinite(one.error_sd) ? answer(one.inside_with_errors()) : "",
                   predicted ? percent(one.relative_error()) : "", unit_words(one.unit),
                   predicted || one.found > 0 ? stable_words(one.is_stable, one.stable) : "",
                   predicted || one.found > 0 ? found_words(one.found, prediction.draws) : ""});
        last = one.motion;
    }
    return table.text();
}

std::string posterior_words(const MotionPrediction& prediction) {
    if (prediction.draws == 0) return "Bands: the delta method, value ± 1.96 sd\n";
    std::string words = fmt::format(
        "Bands: {} from the {}, solved anew for each", counted(prediction.draws, "draw"),
        prediction.from_sample ? "posterior sample of the run" : "normal approximation in the scales of the estimate");
    if (prediction.outside > 0) words += fmt::format(" ({} beyond bounds drawn anew)", prediction.outside);
    return words + "\n";
}

}  // namespace

std::string motion_summary(const MotionPrediction& prediction, const std::string& heading) {
    std::string out = heading + "\n" + posterior_words(prediction);
    if (prediction.has_branch)
        out += titled(fmt::format("Folds, bifurcations and ends of the branch over {}{}", prediction.parameter,
                                  unit_words(prediction.unit).empty() ? "" : " [" + prediction.unit + "]"),
                      marks_table(prediction));
    out += titled("Orbits", orbits_table(prediction));
    out += titled("Measured motions", measured_table(prediction));
    std::string remarks;
    for (const std::string& remark : prediction.remarks)
        remarks += "  " + remark + "\n";
    return out + titled("Remarks", remarks);
}

}  // namespace orbid::apps

#include "apps/results/invariants_file.hpp"

#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "apps/documents/json_text.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

using Json = nlohmann::ordered_json;

Json term_json(const orbits::CycleExpansionTerm& term) {
    return {{"period", term.period},
            {"cycles", term.cycles},
            {"coefficient", term.coefficient},
            {"conservation", term.conservation},
            {"determinant_zero", term.determinant_zero},
            {"zeta_zero", term.zeta_zero},
            {"escape_rate", term.escape_rate},
            {"exponents", json_list(term.exponents)},
            {"metric_entropy", term.metric_entropy},
            {"topological_entropy", term.topological_entropy},
            {"mean_time", term.mean_time},
            {"dimension", term.dimension}};
}

Json expansion_json(const orbits::Invariants& invariants) {
    if (!invariants.expansion) return {{"refused", invariants.expansion_refused}};
    const orbits::CycleExpansion& expansion = *invariants.expansion;
    return {{"rates_per", expansion.timed ? "second" : "section"},
            {"escape_rate_sd", expansion.escape_rate_sd},
            {"exponent_sds", json_list(expansion.exponent_sds)},
            {"index_sums", expansion.index_sums},
            {"by_period", json_list(expansion.by_period, term_json)}};
}

Json lyapunov_json(const orbits::LyapunovSpectrum& spectrum) {
    return {{"rates_per", spectrum.timed ? "second" : "section"},
            {"exponents", json_list(spectrum.exponents)},
            {"sds", json_list(spectrum.sds)},
            {"dimension", spectrum.dimension},
            {"divergence_rate", spectrum.divergence_rate},
            {"divergence_sd", spectrum.divergence_sd},
            {"mean_time", spectrum.mean_time},
            {"order", spectrum.order},
            {"neighbours", spectrum.neighbours},
            {"steps", spectrum.steps},
            {"lost", spectrum.lost},
            {"prediction_error", spectrum.prediction_error},
            {"attenuation", spectrum.attenuation},
            {"remarks", spectrum.remarks}};
}

Json correlation_json(const orbits::CorrelationDimension& correlation) {
    const auto one_scale = [](const auto& scale) -> Json {
        return {{"radius", scale.radius}, {"pairs", scale.pairs},       {"sum", scale.sum},
                {"slope", scale.slope},   {"slope_sd", scale.slope_sd}, {"entropy", scale.entropy}};
    };
    return {{"dimension", correlation.dimension},
            {"sd", correlation.sd},
            {"takens", correlation.takens},
            {"takens_sd", correlation.takens_sd},
            {"largest_radius", correlation.largest_radius},
            {"smallest_radius", correlation.smallest_radius},
            {"rates_per", correlation.timed ? "second" : "section"},
            {"entropy", correlation.entropy},
            {"entropy_sd", correlation.entropy_sd},
            {"theiler", correlation.theiler},
            {"remarks", correlation.remarks},
            {"scales", json_list(correlation.scales, one_scale)}};
}

/// "0.4191 ± 0.0007", or that it is not resolved.
std::string with_sd(double value, double sd) {
    if (!std::isfinite(value)) return "not resolved";
    return std::isfinite(sd) && sd > 0.0 ? fmt::format("{} ± {}", with_digits_of(value, sd), significant(sd, 2))
                                         : significant(value, 6);
}

std::string exponents_text(const Eigen::VectorXd& exponents, const Eigen::VectorXd& sds) {
    std::string text;
    for (Eigen::Index i = 0; i < exponents.size(); ++i)
        text += fmt::format("{}{}", i == 0 ? "" : ", ", with_sd(exponents[i], i < sds.size() ? sds[i] : 0.0));
    return text;
}

}  // namespace

std::string invariants_text(const orbits::Invariants& invariants) {
    Json out{{"format", "orbid-invariants/1"},
             {"cycle_expansion", expansion_json(invariants)},
             {"lyapunov", lyapunov_json(invariants.lyapunov)},
             {"correlation", correlation_json(invariants.correlation)}};
    return json_text(out);
}

std::string invariants_summary(const orbits::Invariants& invariants) {
    const orbits::LyapunovSpectrum& spectrum = invariants.lyapunov;
    const orbits::CorrelationDimension& correlation = invariants.correlation;
    SummaryTable table({left_aligned("invariant"), left_aligned("value")});
    table.add({spectrum.timed ? "Lyapunov exponents [1/s]" : "Lyapunov exponents per section",
               exponents_text(spectrum.exponents, spectrum.sds)});
    table.add({"the largest from diverging neighbours", with_sd(spectrum.divergence_rate, spectrum.divergence_sd)});
    table.add({"Kaplan-Yorke dimension", with_sd(spectrum.dimension, 0.0)});
    table.add({"correlation dimension", with_sd(correlation.dimension, correlation.sd)});
    table.add({"correlation entropy", with_sd(correlation.entropy, correlation.entropy_sd)});
    std::string out = titled("Invariants of the series", table.text());
    for (const auto* remarks : {&spectrum.remarks, &correlation.remarks})
        for (const std::string& remark : *remarks)
            out += fmt::format("  {}\n", remark);
    if (!invariants.expansion) {
        out += fmt::format("  no cycle expansion: {}\n", invariants.expansion_refused);
        return out;
    }
    SummaryTable expansion({"to period", "cycles", "F(1)", "zero", "escape rate", "largest exponent", "entropy"});
    for (const auto& term : invariants.expansion->by_period)
        expansion.add({std::to_string(term.period), std::to_string(term.cycles), significant(term.conservation, 4),
                       significant(term.determinant_zero, 6), significant(term.escape_rate, 4),
                       term.exponents.size() > 0 ? significant(term.exponents[0], 5) : "",
                       significant(term.topological_entropy, 4)});
    return out + titled("Cycle expansion", expansion.text());
}

}  // namespace orbid::apps

#include <cmath>

#include <fmt/format.h>

#include "apps/results/posterior_results.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

std::string interval(double lower, double upper, double sd) {
    const auto end = [sd](double x) { return std::isfinite(x) ? with_digits_of(x, sd) : std::string("open"); };
    return fmt::format("[{}, {}]", end(lower), end(upper));
}

std::string sample_table(const estimator::PosteriorSample& sample) {
    SummaryTable table({left_aligned("name"), left_aligned("unit"), "mean", "sd", left_aligned("95 % interval"),
                        "R-hat", "bulk", "tail"});
    for (const auto* list : {&sample.parameters, &sample.derived, &sample.errors}) {
        for (const estimator::SampledQuantity& x : *list)
            table.add({x.name, x.unit, with_digits_of(x.mean, x.sd), significant(x.sd, 3),
                       interval(x.quantiles.front(), x.quantiles.back(), x.sd), fmt::format("{:.3f}", x.rhat),
                       fmt::format("{:.0f}", x.bulk_size), fmt::format("{:.0f}", x.tail_size)});
    }
    std::string out = table.text();
    if (sample.status != estimator::SampleStatus::complete)
        out += fmt::format("  {}{}{}\n", name(sample.status), sample.message.empty() ? "" : ": ", sample.message);
    if (!sample.trusted && !sample.distrust.empty()) out += fmt::format("  Do not trust yet: {}.\n", sample.distrust);
    return out;
}

std::string marginal_table(const std::vector<estimator::Marginal>& marginals) {
    SummaryTable table({left_aligned("name"), left_aligned("unit"), "mean", "sd", "median",
                        left_aligned("95 % interval"), left_aligned("")});
    for (const estimator::Marginal& x : marginals) {
        if (!x.known) {
            table.add({x.name, x.unit, "", "", "", "undefined", x.message});
            continue;
        }
        table.add({x.name, x.unit, with_digits_of(x.mean, x.sd), significant(x.sd, 3), with_digits_of(x.median, x.sd),
                   interval(x.lower95, x.upper95, x.sd), x.message});
    }
    return table.text();
}

std::string profile_table(const std::vector<estimator::Profile>& profiles) {
    SummaryTable table({left_aligned("name"), left_aligned("unit"), "value", left_aligned("95 % interval"),
                        left_aligned("method"), left_aligned("")});
    for (const estimator::Profile& x : profiles) {
        // A quarter of the interval is about one sd.
        const double width = 0.25 * (x.upper - x.lower);
        const double sd = std::isfinite(width) ? width : std::abs(x.value);
        table.add({x.name, x.unit, with_digits_of(x.value, sd),
                   x.known ? interval(x.lower, x.upper, sd) : std::string("undefined"), x.method, x.message});
    }
    return table.text();
}

std::string optima_table(const PosteriorResults& results) {
    if (results.runs.empty()) return {};
    std::vector<SummaryTable::Column> columns{{"objective"}, {"starts"}};
    for (const std::string& name : results.parameters)
        columns.push_back({name});
    SummaryTable table(columns);
    for (const estimator::Optimum& optimum : results.optima) {
        SummaryTable::Row cells{fmt::format("{:.6g}", optimum.objective), std::to_string(optimum.starts.size())};
        for (Eigen::Index i = 0; i < optimum.theta.size(); ++i)
            cells.push_back(significant(optimum.theta[i], 5));
        table.add(std::move(cells));
    }
    std::size_t lost = 0;
    for (const estimator::StartedRun& run : results.runs)
        lost += run.optimum < 0 ? 1 : 0;
    return table.text() +
           (lost > 0 ? fmt::format("  {} of {} starts ended at no optimum\n", lost, results.runs.size()) : "");
}

std::string diagnostic_table(const std::vector<GroupDiagnostic>& groups) {
    SummaryTable table({left_aligned("group"), "records", "normal, p", "lag-1", "white, p", "runs, p", "outliers"});
    const auto p_text = [](double p) { return std::isfinite(p) ? fmt::format("{:.2g}", p) : std::string(); };
    for (const GroupDiagnostic& group : groups) {
        const estimator::ResidualDiagnostic& d = group.diagnostic;
        const double normal = std::isfinite(d.shapiro_wilk.p) ? d.shapiro_wilk.p : d.anderson_darling.p;
        table.add({group.group, std::to_string(d.count), p_text(normal),
                   std::isfinite(d.lag1) ? fmt::format("{:.3f}", d.lag1) : "", p_text(d.ljung_box.p), p_text(d.runs.p),
                   std::to_string(group.outliers.size())});
    }
    return table.text();
}

}  // namespace

std::string posterior_summary(const PosteriorResults& results) {
    std::string out = titled("Residuals", diagnostic_table(results.diagnostics));
    out += titled("Optima", optima_table(results));
    out += titled("Profile likelihood", profile_table(results.profiles));
    out += titled("Marginal densities (nested Laplace)", marginal_table(results.marginals));
    if (results.bootstrap) out += titled("Intervals by simulation", bootstrap_summary(*results.bootstrap));
    if (results.sample) out += titled("Posterior sample", sample_table(*results.sample));
    std::string refused;
    for (const auto& [block, reason] : results.refused)
        refused += fmt::format("  {}: {}\n", block, reason);
    return out + titled("Not done", refused);
}

}  // namespace orbid::apps

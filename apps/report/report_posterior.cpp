#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "apps/report/html_text.hpp"
#include "apps/report/plots/run_charts.hpp"
#include "apps/report/report_chapter.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

using namespace detail;

std::string posterior_interval_text(const Json& entry) {
    const auto ends = ends_at(entry, "interval95");
    if (!ends) return "";
    const double sd = number_at(entry, "sd");
    const auto end = [sd](double value) {
        if (!std::isfinite(value)) return std::string("open");
        return std::isfinite(sd) ? with_digits_of(value, sd) : significant(value, 5);
    };
    return fmt::format("[{}, {}]", end(ends->front()), end(ends->back()));
}

std::string profile_table(const Json& profiles) {
    SummaryTable table({left_aligned("parameter"), "value", left_aligned("unit"), left_aligned("95 % interval"),
                        left_aligned("method"), left_aligned("remark")});
    for (const auto& [name, profile] : profiles.items())
        table.add({name, number_cell(number_at(profile, "value"), 6), text_at(profile, "unit"),
                   posterior_interval_text(profile), text_at(profile, "method"), text_at(profile, "message")});
    return html_table("Intervals from profiles", table);
}

std::string marginal_table(const Json& marginals) {
    SummaryTable table({left_aligned("quantity"), "mean", "sd", "median", left_aligned("95 % interval"),
                        left_aligned("unit"), left_aligned("remark")});
    for (const auto& [name, entry] : marginals.items()) {
        const double sd = number_at(entry, "sd");
        table.add({name, estimate_cell(number_at(entry, "mean"), sd), number_cell(sd, 3),
                   estimate_cell(number_at(entry, "median"), sd), posterior_interval_text(entry),
                   text_at(entry, "unit"), text_at(entry, "message")});
    }
    return html_table("Marginals by nested Laplace approximations", table);
}

std::string sample_table(const Json& posterior) {
    SummaryTable table({left_aligned("quantity"), "mean", "sd", "median", left_aligned("95 % interval"),
                        left_aligned("unit"), explained("R-hat", "agreement of the chains: below 1.01"),
                        explained("bulk size", "independent draws that the mean is worth"),
                        explained("tail size", "the same for the ends of the interval")});
    for (const char* list : {"parameters", "derived", "errors"}) {
        for (const auto& [name, entry] : block_at(posterior, list).items()) {
            const double sd = number_at(entry, "sd");
            const double rhat = number_at(entry, "rhat");
            table.add({name, estimate_cell(number_at(entry, "mean"), sd), number_cell(sd, 3),
                       estimate_cell(number_at(entry, "median"), sd), posterior_interval_text(entry),
                       text_at(entry, "unit"), number_cell(rhat, 5, rhat < 1.01 ? "" : "caution"),
                       formatted_cell("{:.0f}", number_at(entry, "bulk_size")),
                       formatted_cell("{:.0f}", number_at(entry, "tail_size"))});
        }
    }
    return html_table("Draws from the posterior", table);
}

std::string interval_between(const Json& entry, const char* ends) {
    return posterior_interval_text(
        {{"interval95", block_at(entry, ends)}, {"sd", entry.value("bootstrap_sd", Json())}});
}

/// Sds and intervals by simulation beside those by curvature.
std::string simulated_table(const Json& intervals) {
    SummaryTable table(
        {left_aligned("quantity"), "sd by curvature", "sd by simulation",
         explained("bias", "mean of the replicates minus the estimate, in sds of theirs"),
         explained(left_aligned("percentile 95 %"), "where 95 % of the replicates lie"),
         explained(left_aligned("studentised 95 %"),
                   "by the replicates' deviations over their own sds: free of bias, as wide as they ask"),
         left_aligned("unit"), left_aligned("remark")});
    const bool refused = !text_at(intervals, "refused").empty();
    for (const char* list : {"parameters", "derived", "errors"}) {
        for (const auto& [name, entry] : block_at(intervals, list).items()) {
            // More than half a sd of bias, or an sd that is off by half, is no rounding of the number of replicates.
            const double bias = number_at(entry, "bias_in_sds");
            const double ratio = number_at(entry, "bootstrap_sd") / number_at(entry, "sd");
            const bool far = ratio > 1.5 || ratio < 1.0 / 1.5;
            const auto interval = [&, &row = entry](const char* ends) {
                const auto known = ends_at(row, ends);
                return refused || !known || std::isnan(known->front()) ? std::string() : interval_between(row, ends);
            };
            table.add({name, number_cell(number_at(entry, "sd"), 3),
                       number_cell(number_at(entry, "bootstrap_sd"), 3, far ? "caution" : ""),
                       number_cell(bias, 2, std::abs(bias) > 0.5 ? "caution" : ""), interval("percentile95"),
                       interval("studentised95"), text_at(entry, "unit"), text_at(entry, "remark")});
        }
    }
    return html_table("Intervals by simulation", table);
}

std::string simulated_intervals(const Json& intervals) {
    const auto count = [&](const char* key) { return fmt::format("{:.0f}", number_at(intervals, key)); };
    const bool blocks = text_at(intervals, "kind") == "blocks";
    std::string text = fmt::format(
        "{} records were drawn anew from the estimate, with {}, and estimated again from there; {} failed.",
        count("replicates"),
        blocks ? fmt::format("its residuals in blocks of {}", count("block")) : "errors of the estimated laws",
        count("failed"));
    const std::string refused = text_at(intervals, "refused");
    if (!refused.empty()) text += fmt::format(" No intervals: {}.", refused);
    std::string html = html_paragraph(text);
    for (const Json& failure : block_at(intervals, "failures"))
        html += html_paragraph(fmt::format("{:.0f} {}: {}", number_at(failure, "count"), text_at(failure, "status"),
                                           text_at(failure, "message")));
    return html + simulated_table(intervals);
}

std::string starts_table(const Json& result) {
    const Json& optima = block_at(result, "optima");
    if (optima.empty()) return "";
    std::vector<SummaryTable::Column> columns{"optimum", "objective", "starts that ended there"};
    for (const auto& [name, value] : block_at(optima.front(), "parameters").items())
        columns.push_back({name});
    SummaryTable table(columns);
    std::size_t number = 0;
    for (const Json& optimum : optima) {
        SummaryTable::Row cells{std::to_string(number++), number_cell(number_at(optimum, "objective"), 9),
                                std::to_string(block_at(optimum, "starts").size())};
        for (const auto& [name, value] : block_at(optimum, "parameters").items())
            cells.emplace_back(significant(number_of(value), 6));
        cells.resize(columns.size(), "");
        table.add(std::move(cells));
    }
    return html_table("Optima that several starts ended in", table);
}

}  // namespace

ReportChapter posterior_chapter(const ReportSource& source) {
    ReportChapter chapter{"posterior", "Posterior", ""};
    if (!source.run.result) return chapter;
    const Json& result = *source.run.result;
    const auto block = [&](const char* name) -> const Json& {
        static const Json none = Json::object();
        const Json& found = block_at(result, name);
        // Asked for, and it could not be done: { "status": "refused", "message": ... }.
        const std::string reason = text_at(found, "status") == "refused" ? text_at(found, "message") : std::string();
        if (reason.empty()) return found;
        chapter.html += html_paragraph(fmt::format("{}: {}", name, reason));
        return none;
    };
    const Json& profiles = block("profile");
    const Json& marginals = block("marginals");
    const Json& posterior = block("posterior");
    const Json& intervals = block("intervals");
    if (!profiles.empty())
        chapter.html += html_headed(3, "Profiles",
                                    figure_html(profile_chart(source.run),
                                                "What is lost when one parameter is held and the others follow: the "
                                                "signed root of twice the rise of the objective. A straight line is "
                                                "the normal approximation; where the curve leaves it, trust the "
                                                "profile.") +
                                        profile_table(profiles));
    std::optional<StoredDraws> draws;
    if (!posterior.empty()) draws = stored_draws(source.run);
    if (!marginals.empty() || draws)
        chapter.html += html_headed(
            3, "Densities",
            figure_html(marginal_chart(source.run, draws),
                        "Density of one quantity, all others integrated out. Lines are approximations, columns count "
                        "draws; they should agree.") +
                figure_html(posterior_chart(source.run, draws),
                            "Draws of the parameters in pairs: what is long and narrow, or bent, is known as a "
                            "combination."));
    chapter.html += marginal_table(marginals) + sample_table(posterior);
    if (!intervals.empty()) chapter.html += html_headed(3, "By simulation", simulated_intervals(intervals));
    chapter.html += html_headed(3, "Several starts", starts_table(result));
    return chapter;
}

}  // namespace orbid::apps

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

/// A block that was asked for and could not be done: { "status": "refused", "message": ... }.
std::string refusal(const Json& block) {
    return text_at(block, "status") == "refused" ? text_at(block, "message") : std::string();
}

std::string posterior_interval_text(const Json& entry) {
    const Json* ends = filled(entry, "interval95");
    if (ends == nullptr) return "";
    const double sd = number_at(entry, "sd");
    const auto end = [sd](const Json& value) {
        return value.is_number()
                   ? std::isfinite(sd) ? with_digits_of(value.get<double>(), sd) : significant(value.get<double>(), 5)
                   : std::string("open");
    };
    return fmt::format("[{}, {}]", end((*ends)[0]), end((*ends)[1]));
}

std::string profile_table(const Json& profiles) {
    HtmlTable table("Intervals from profiles", {{"parameter", false},
                                                {"value"},
                                                {"unit", false},
                                                {"95 % interval", false},
                                                {"method", false},
                                                {"remark", false}});
    for (const auto& [name, profile] : profiles.items())
        table.add({name, number_cell(number_at(profile, "value"), 6), text_at(profile, "unit"),
                   posterior_interval_text(profile), text_at(profile, "method"), text_at(profile, "message")});
    return table.html();
}

std::string marginal_table(const Json& marginals) {
    HtmlTable table("Marginals by nested Laplace approximations", {{"quantity", false},
                                                                   {"mean"},
                                                                   {"sd"},
                                                                   {"median"},
                                                                   {"95 % interval", false},
                                                                   {"unit", false},
                                                                   {"remark", false}});
    for (const auto& [name, entry] : marginals.items()) {
        const double sd = number_at(entry, "sd");
        table.add({name, estimate_cell(number_at(entry, "mean"), sd), number_cell(sd, 3),
                   estimate_cell(number_at(entry, "median"), sd), posterior_interval_text(entry),
                   text_at(entry, "unit"), text_at(entry, "message")});
    }
    return table.html();
}

std::string sample_table(const Json& posterior) {
    HtmlTable table("Draws from the posterior", {{"quantity", false},
                                                 {"mean"},
                                                 {"sd"},
                                                 {"median"},
                                                 {"95 % interval", false},
                                                 {"unit", false},
                                                 {"R-hat", true, "agreement of the chains: below 1.01"},
                                                 {"bulk size", true, "independent draws that the mean is worth"},
                                                 {"tail size", true, "the same for the ends of the interval"}});
    for (const char* list : {"parameters", "derived", "errors"}) {
        const Json* entries = filled(posterior, list);
        if (entries == nullptr) continue;
        for (const auto& [name, entry] : entries->items()) {
            const double sd = number_at(entry, "sd");
            const double rhat = number_at(entry, "rhat");
            const double bulk = number_at(entry, "bulk_size");
            const double tail = number_at(entry, "tail_size");
            table.add({name,
                       estimate_cell(number_at(entry, "mean"), sd),
                       number_cell(sd, 3),
                       estimate_cell(number_at(entry, "median"), sd),
                       posterior_interval_text(entry),
                       text_at(entry, "unit"),
                       number_cell(rhat, 5, rhat < 1.01 ? "" : "caution"),
                       {std::isfinite(bulk) ? fmt::format("{:.0f}", bulk) : "", bulk},
                       {std::isfinite(tail) ? fmt::format("{:.0f}", tail) : "", tail}});
        }
    }
    return table.html();
}

std::string starts_table(const Json& result) {
    const Json* optima = filled(result, "optima");
    if (optima == nullptr) return "";
    std::vector<HtmlTable::Column> columns{{"optimum"}, {"objective"}, {"starts that ended there"}};
    if (const Json* first = filled(optima->front(), "parameters")) {
        for (const auto& [name, value] : first->items())
            columns.push_back({name});
    }
    HtmlTable table("Optima that several starts ended in", columns);
    std::size_t number = 0;
    for (const Json& optimum : *optima) {
        const Json* starts = filled(optimum, "starts");
        const double objective = number_at(optimum, "objective");
        std::vector<HtmlTable::Cell> cells{std::to_string(number++), number_cell(objective, 9),
                                           std::to_string(starts != nullptr ? starts->size() : 0)};
        if (optimum.contains("starts") && optimum["starts"].is_number()) cells[2] = optimum["starts"].dump();
        if (const Json* parameters = filled(optimum, "parameters")) {
            for (const auto& [name, value] : parameters->items())
                cells.emplace_back(value.is_number() ? significant(value.get<double>(), 6) : "");
        }
        cells.resize(columns.size(), HtmlTable::Cell(""));
        table.add(std::move(cells));
    }
    return table.html();
}

}  // namespace

ReportChapter posterior_chapter(const ReportSource& source) {
    ReportChapter chapter{"posterior", "Posterior", ""};
    if (!source.run.result) return chapter;
    const Json& result = *source.run.result;
    const auto block = [&](const char* name) -> const Json* {
        const Json* found = filled(result, name);
        if (found == nullptr) return nullptr;
        const std::string reason = refusal(*found);
        if (reason.empty()) return found;
        chapter.html += html_paragraph(fmt::format("{}: {}", name, reason));
        return nullptr;
    };
    const Json* profiles = block("profile");
    const Json* marginals = block("marginals");
    const Json* posterior = block("posterior");
    if (profiles != nullptr)
        chapter.html += html_headed(3, "Profiles",
                                    figure_html(profile_chart(source.run),
                                                "What is lost when one parameter is held and the others follow: the "
                                                "signed root of twice the rise of the objective. A straight line is "
                                                "the normal approximation; where the curve leaves it, trust the "
                                                "profile.") +
                                        profile_table(*profiles));
    std::optional<StoredDraws> draws;
    if (posterior != nullptr) draws = stored_draws(source.run);
    if (marginals != nullptr || draws)
        chapter.html += html_headed(
            3, "Densities",
            figure_html(marginal_chart(source.run, draws),
                        "Density of one quantity, all others integrated out. Lines are approximations, columns count "
                        "draws; they should agree.") +
                figure_html(posterior_chart(source.run, draws),
                            "Draws of the parameters in pairs: what is long and narrow, or bent, is known as a "
                            "combination."));
    if (marginals != nullptr) chapter.html += marginal_table(*marginals);
    if (posterior != nullptr) chapter.html += sample_table(*posterior);
    chapter.html += html_headed(3, "Several starts", starts_table(result));
    return chapter;
}

}  // namespace orbid::apps

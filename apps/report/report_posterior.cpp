#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "apps/report/html_text.hpp"
#include "apps/report/plots/marginal_density.hpp"
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

ChartLayer upright(double at, std::string name, std::string ink, bool dash) {
    ChartLayer rule{"rule", std::move(name), 1, std::move(ink)};
    rule.at_x = at;
    rule.dash = dash;
    return rule;
}

/// The estimate and, where it is known, the reference.
void add_marks(const Json& result, const std::string& name, ChartView& view) {
    for (const char* list : {"parameters", "derived"}) {
        const Json* found = filled(filled(result, list), name);
        if (found == nullptr) continue;
        const double reference = number_at(*found, "reference");
        if (std::isfinite(reference)) view.layers.push_back(upright(reference, "reference", "ink", false));
    }
}

Chart profile_chart(const Json& result, const Json& profiles) {
    Chart chart{"profiles", "Profile likelihood", "Parameter", {}};
    for (const auto& [name, profile] : profiles.items()) {
        const Json* points = filled(profile, "points");
        if (points == nullptr) continue;
        ChartLayer curve{"line", "profile", 1, ""};
        ChartLayer dots{"points", "profile", 1, ""};
        ChartLayer parabola{"line", "normal approximation", 2, ""};
        parabola.dash = true;
        const Json* parameter = filled(filled(result, "parameters"), name);
        const double sd = parameter == nullptr ? std::nan("") : number_at(*parameter, "sd");
        const double best = number_at(profile, "value");
        ChartRange x;
        ChartRange y;
        y.include(-2.5);
        y.include(2.5);
        for (const Json& point : *points) {
            const double root = number_at(point, "signed_root");
            if (!std::isfinite(root)) continue;
            curve.x.push_back(number_at(point, "value"));
            curve.y.push_back(root);
            x.include(curve.x.back());
            y.include(root);
        }
        if (curve.x.size() < 2) continue;
        dots.x = curve.x;
        dots.y = curve.y;
        ChartView view;
        view.label = name;
        view.x = x.axis(name, text_at(profile, "unit"));
        view.y = y.axis("signed root of twice the rise of the objective", "");
        view.height = 0.45;
        if (sd > 0.0) {
            parabola.x = {view.x.lower, view.x.upper};
            parabola.y = {(view.x.lower - best) / sd, (view.x.upper - best) / sd};
            view.layers.push_back(std::move(parabola));
        }
        const double threshold = number_at(profile, "threshold");
        for (const double side : {-1.0, 1.0}) {
            if (!(threshold > 0.0)) break;
            ChartLayer limit{"rule", "95 % limits", 1, "soft"};
            // The threshold is one of twice the objective's loss, of which the root is drawn.
            limit.at_y = side * std::sqrt(threshold);
            limit.dash = true;
            view.layers.push_back(std::move(limit));
        }
        add_marks(result, name, view);
        view.layers.push_back(std::move(curve));
        view.layers.push_back(std::move(dots));
        chart.views.push_back(std::move(view));
    }
    return chart;
}

std::string profile_table(const Json& profiles) {
    HtmlTable table("Intervals from profiles", {{"parameter", false},
                                                {"value"},
                                                {"unit", false},
                                                {"95 % interval", false},
                                                {"method", false},
                                                {"remark", false}});
    for (const auto& [name, profile] : profiles.items())
        table.add({name,
                   {significant(number_at(profile, "value"), 6), number_at(profile, "value")},
                   text_at(profile, "unit"),
                   posterior_interval_text(profile),
                   text_at(profile, "method"),
                   text_at(profile, "message")});
    return table.html();
}

/// Densities: Laplace's marginals as lines, draws as columns where posterior.csv is there.
Chart marginal_chart(const Json& result, const Json* marginals, const std::optional<StoredDraws>& draws) {
    Chart chart{"marginals", "Marginal posterior densities", "Quantity", {}};
    std::vector<std::string> names;
    if (marginals != nullptr) {
        for (const auto& [name, marginal] : marginals->items())
            names.push_back(name);
    }
    if (draws) {
        for (const std::string& name : draws->names)
            if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
    }
    for (const std::string& name : names) {
        ChartView view;
        ChartRange x;
        ChartRange y;
        y.include(0.0);
        std::string unit;
        if (draws) {
            const auto column = std::find(draws->names.begin(), draws->names.end(), name);
            if (column != draws->names.end()) {
                const auto& values = draws->columns[static_cast<std::size_t>(column - draws->names.begin())];
                const auto [least, greatest] = std::minmax_element(values.begin(), values.end());
                if (!values.empty() && *greatest > *least) {
                    // Sturges' rule doubled: thousands of draws carry finer columns than its normal ones.
                    const auto columns =
                        static_cast<std::size_t>(2.0 * (1.0 + std::log2(static_cast<double>(values.size()))));
                    const double width = (*greatest - *least) / static_cast<double>(columns);
                    ChartLayer bars{"bars", "draws", 2, ""};
                    bars.y.assign(columns, 0.0);
                    for (const double value : values)
                        bars.y[std::min(columns - 1, static_cast<std::size_t>((value - *least) / width))] += 1.0;
                    for (std::size_t k = 0; k <= columns; ++k)
                        bars.x.push_back(*least + width * static_cast<double>(k));
                    for (double& height : bars.y) {
                        height /= static_cast<double>(values.size()) * width;
                        y.include(height);
                    }
                    x.include(bars.x);
                    view.layers.push_back(std::move(bars));
                }
            }
        }
        if (const Json* marginal = filled(marginals, name)) {
            unit = text_at(*marginal, "unit");
            ChartLayer line{"line", "nested Laplace", 1, ""};
            if (const Json* points = filled(*marginal, "points")) {
                MarginalDensity density = marginal_density(*points);
                line.x = std::move(density.x);
                line.y = std::move(density.y);
                x.include(line.x);
                y.include(line.y);
            }
            if (line.x.size() > 1) view.layers.push_back(std::move(line));
        }
        if (view.layers.empty()) continue;
        add_marks(result, name, view);
        view.label = name;
        view.x = x.axis(name, unit);
        view.y = y.axis("density", "");
        view.y.lower = 0.0;
        view.height = 0.45;
        chart.views.push_back(std::move(view));
    }
    return chart;
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
        table.add({name,
                   {with_digits_of(number_at(entry, "mean"), sd), number_at(entry, "mean")},
                   {significant(sd, 3), sd},
                   {with_digits_of(number_at(entry, "median"), sd), number_at(entry, "median")},
                   posterior_interval_text(entry),
                   text_at(entry, "unit"),
                   text_at(entry, "message")});
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
                       {with_digits_of(number_at(entry, "mean"), sd), number_at(entry, "mean")},
                       {significant(sd, 3), sd},
                       {with_digits_of(number_at(entry, "median"), sd), number_at(entry, "median")},
                       posterior_interval_text(entry),
                       text_at(entry, "unit"),
                       {significant(rhat, 5), rhat, rhat < 1.01 ? "" : "caution"},
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
        std::vector<HtmlTable::Cell> cells{std::to_string(number++),
                                           {significant(objective, 9), objective},
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
                                    figure_html(source, profile_chart(result, *profiles),
                                                "What is lost when one parameter is held and the others follow. A "
                                                "straight line is the normal approximation; where the curve leaves it, "
                                                "trust the profile.") +
                                        profile_table(*profiles));
    std::optional<StoredDraws> draws;
    if (posterior != nullptr) draws = stored_draws(source.run);
    Chart density_chart = marginal_chart(result, marginals, draws);
    // Of draws alone the still picture is another.
    if (marginals == nullptr) density_chart.name = "posterior";
    if (marginals != nullptr || draws)
        chapter.html += html_headed(
            3, "Densities",
            figure_html(source, density_chart,
                        "Density of one quantity, all others integrated out. Lines are approximations, columns count "
                        "draws; they should agree."));
    if (marginals != nullptr) chapter.html += marginal_table(*marginals);
    if (posterior != nullptr) chapter.html += sample_table(*posterior);
    chapter.html += html_headed(3, "Several starts", starts_table(result));
    return chapter;
}

}  // namespace orbid::apps

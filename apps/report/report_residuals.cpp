#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
#include <tuple>

#include <fmt/format.h>
#include <boost/math/distributions/normal.hpp>

#include "apps/drawing/plot_axis.hpp"
#include "apps/report/html_text.hpp"
#include "apps/report/report_chapter.hpp"
#include "apps/results/summary_table.hpp"
#include "apps/stored_run/stored_record.hpp"

namespace orbid::apps {

namespace {

using namespace detail;

/// Rows that a page carries; of more, every k-th of a block. 2^18 are some 3 MB.
constexpr std::size_t most_rows = std::size_t{1} << 18;
/// Pictures one may choose among; a list of more is no choice.
constexpr std::size_t most_views = 300;
/// A block with fewer records has no course in time to look at.
constexpr std::size_t course_records = 8;

using Rows = std::vector<const ResidualRow*>;

double scaled(const ResidualRow& row) {
    return row.sd > 0.0 ? (row.observed - row.predicted) / row.sd : std::nan("");
}

/// Rows of one coordinate by block, in the order of the file.
struct Group {
    std::string experiment;
    std::string coordinate;
    std::vector<std::pair<std::string, Rows>> blocks;
    bool cycles = false;
    std::string place = "time or phase";  ///< what residuals.csv counts along
    std::string place_unit = {};
    std::string unit = {};  ///< of the coordinate
};

std::vector<Group> groups_of(const std::vector<ResidualRow>& rows) {
    std::vector<Group> groups;
    std::map<std::tuple<std::string, std::string, bool>, std::size_t> place;
    std::map<std::tuple<std::size_t, std::string>, std::size_t> block_place;
    const std::size_t every = std::max<std::size_t>(1, (rows.size() + most_rows - 1) / most_rows);
    std::map<std::size_t, std::size_t> seen;
    for (const ResidualRow& row : rows) {
        const auto [found, fresh] =
            place.try_emplace({row.experiment, row.coordinate, catalog::is_cycle(row)}, groups.size());
        if (fresh) groups.push_back({row.experiment, row.coordinate, {}, catalog::is_cycle(row)});
        if (seen[found->second]++ % every != 0) continue;
        Group& group = groups[found->second];
        const auto [block, first] = block_place.try_emplace({found->second, row.block}, group.blocks.size());
        if (first) group.blocks.push_back({row.block, {}});
        group.blocks[block->second].second.push_back(&row);
    }
    return groups;
}

/// Samples are placed by time, sections by the phase of their forcing or by time.
void name_axes(Group& group, const StoredRun& run, const ModelJob& model) {
    if (catalog::is_sampled(run, group.experiment)) {
        group.place = "time";
        group.place_unit = catalog::time_unit(model);
    }
    group.unit = catalog::coordinate_of(model, group.coordinate).unit;
}

std::string label_of(const Group& group, bool several) {
    return several ? fmt::format("{}: {}", group.experiment, display_name(group.coordinate))
                   : display_name(group.coordinate);
}

bool has_several_experiments(const std::vector<Group>& groups) {
    std::set<std::string> names;
    for (const Group& group : groups)
        names.insert(group.experiment);
    return names.size() > 1;
}

ChartLayer level(double at, std::string name, bool dash) {
    ChartLayer rule{"rule", std::move(name), 1, "soft"};
    rule.at_y = at;
    rule.dash = dash;
    return rule;
}

Chart residual_chart(const std::vector<Group>& groups) {
    Chart chart{"residuals", "Residuals in standard deviations", "Coordinate", {}};
    const bool several = has_several_experiments(groups);
    for (const Group& group : groups) {
        ChartView view;
        ChartRange x;
        ChartRange y;
        y.include(-3.0);
        y.include(3.0);
        view.layers = {level(0.0, "", false), level(1.96, "± 1.96", true), level(-1.96, "± 1.96", true)};
        ChartLayer cycles{"points", "cycles", 2, ""};
        std::size_t index = 0;
        for (const auto& [block, rows] : group.blocks) {
            ChartLayer layer{"points", fmt::format("segment {}", block), 1 + static_cast<int>(index % 8), ""};
            ChartLayer& out = group.cycles ? cycles : layer;
            for (const ResidualRow* row : rows) {
                out.x.push_back(group.cycles ? static_cast<double>(index) : row->at);
                out.y.push_back(scaled(*row));
                if (group.cycles) out.labels.push_back(block);
                x.include(out.x.back());
                y.include(out.y.back());
            }
            ++index;
            if (!group.cycles && std::any_of(layer.y.begin(), layer.y.end(), [](double v) { return std::isfinite(v); }))
                view.layers.push_back(std::move(layer));
        }
        if (group.cycles) view.layers.push_back(std::move(cycles));
        if (x.empty()) continue;
        view.label = label_of(group, several);
        view.x = x.axis(group.cycles ? "cycles, in their order" : group.place, group.cycles ? "" : group.place_unit);
        view.x.deep = true;
        view.y = y.axis("residual / sd", "");
        view.height = 0.42;
        chart.views.push_back(std::move(view));
        if (chart.views.size() == most_views) break;
    }
    return chart;
}

/// Sorted residuals over the quantiles of the normal distribution: (k - 0.5) / n.
Chart quantile_chart(const std::vector<Group>& groups) {
    constexpr std::size_t shown = 1200;  // the tails whole, of the middle every k-th: a line to the eye
    constexpr std::size_t tail = 200;
    Chart chart{"normal_quantiles", "Residuals against the quantiles of the normal distribution", "Coordinate", {}};
    const bool several = has_several_experiments(groups);
    const boost::math::normal_distribution<double> normal;
    for (const Group& group : groups) {
        std::vector<double> values;
        for (const auto& [block, rows] : group.blocks) {
            for (const ResidualRow* row : rows)
                if (std::isfinite(scaled(*row))) values.push_back(scaled(*row));
        }
        if (values.size() < 3) continue;
        std::sort(values.begin(), values.end());
        ChartLayer points{"points", "residuals", 2, ""};
        const auto n = values.size();
        const std::size_t every = n <= shown ? 1 : (n - 2 * tail) / (shown - 2 * tail);
        ChartRange range;
        for (std::size_t k = 0; k < n; ++k) {
            if (k >= tail && k + tail < n && k % every != 0) continue;
            points.x.push_back(boost::math::quantile(normal, (static_cast<double>(k) + 0.5) / static_cast<double>(n)));
            points.y.push_back(values[k]);
            range.include(points.x.back());
            range.include(points.y.back());
        }
        ChartView view;
        view.label = label_of(group, several);
        view.x = range.axis("normal quantile", "");
        view.y = range.axis("residual / sd", "");
        view.height = 0.6;
        ChartLayer line{"line", "normal", 1, "soft"};
        line.x = line.y = {view.x.lower, view.x.upper};
        view.layers = {std::move(line), std::move(points)};
        chart.views.push_back(std::move(view));
        if (chart.views.size() == most_views) break;
    }
    return chart;
}

ChartView course_view(const Group& group, const std::string& block, const Rows& rows, bool several) {
    ChartLayer observed{"points", "observed", 6, ""};
    ChartLayer predicted{"line", "predicted", 1, ""};
    ChartRange x;
    ChartRange y;
    for (const ResidualRow* row : rows) {
        observed.x.push_back(row->at);
        observed.y.push_back(row->observed);
        predicted.x.push_back(row->at);
        predicted.y.push_back(row->predicted);
        x.include(row->at);
        y.include(row->observed);
        y.include(row->predicted);
    }
    ChartView view;
    view.label = group.blocks.size() == 1 && several ? label_of(group, several)
                                                     : fmt::format("{}, segment {}", label_of(group, several), block);
    view.x = x.axis(group.place, group.place_unit);
    view.x.deep = true;
    view.y = y.axis(display_name(group.coordinate), group.unit);
    view.height = 0.42;
    view.layers = {std::move(observed), std::move(predicted)};
    return view;
}

/// Cycles have no course: observed against predicted, where every point should lie on the line.
ChartView cycle_view(const Group& group, bool several) {
    ChartLayer points{"points", "points of cycles", 2, ""};
    ChartRange range;
    for (const auto& [block, rows] : group.blocks) {
        for (const ResidualRow* row : rows) {
            points.x.push_back(row->predicted);
            points.y.push_back(row->observed);
            points.labels.push_back(block);
            range.include(row->predicted);
            range.include(row->observed);
        }
    }
    ChartView view;
    view.label = label_of(group, several);
    view.x = range.axis(fmt::format("{} predicted", display_name(group.coordinate)), group.unit);
    view.y = range.axis(fmt::format("{} observed", display_name(group.coordinate)), group.unit);
    view.height = 0.6;
    ChartLayer line{"line", "equal", 1, "soft"};
    line.x = line.y = {view.x.lower, view.x.upper};
    view.layers = {std::move(line), std::move(points)};
    return view;
}

Chart prediction_chart(const std::vector<Group>& groups) {
    Chart chart{"prediction", "Observed and predicted values", "Record", {}};
    const bool several = has_several_experiments(groups);
    for (const Group& group : groups) {
        if (group.cycles) {
            chart.views.push_back(cycle_view(group, several));
            continue;
        }
        for (const auto& [block, rows] : group.blocks) {
            if (chart.views.size() >= most_views) return chart;
            if (rows.size() >= course_records) chart.views.push_back(course_view(group, block, rows, several));
        }
    }
    return chart;
}

std::string prediction_table(const Json& predictions) {
    HtmlTable table("How far predictions are off", {{"experiment", false},
                                                    {"segment", false},
                                                    {"role", false},
                                                    {"rms", false},
                                                    {"rms / error sd", true, "near 1 where the model holds"}});
    for (const Json& entry : predictions) {
        std::string rms;
        if (const Json* list = filled(entry, "rms")) {
            for (const auto& [coordinate, value] : list->items())
                rms += fmt::format("{}{} {}", rms.empty() ? "" : ", ", coordinate,
                                   value.is_number() ? significant(value.get<double>(), 4) : "undefined");
        }
        const double normalised = number_at(entry, "normalised_rms");
        table.add({text_at(entry, "experiment"),
                   text_at(entry, "segment"),
                   entry.value("fitted", false) ? "fitted" : "predicted",
                   rms,
                   {significant(normalised, 3), normalised, normalised > 2.0 ? "caution" : ""}});
    }
    return table.html();
}

double p_of(const Json& group, const char* test) {
    const Json* found = filled(group, test);
    return found == nullptr ? std::nan("") : number_at(*found, "p");
}

HtmlTable::Cell p_cell(double p) {
    // Not evidence against the model for itself: of a hundred tests one falls below.
    return {significant(p, 2), p, p < 0.01 ? "caution" : ""};
}

std::string diagnostics_table(const Json& diagnostics) {
    HtmlTable table("What the residuals say of the error model",
                    {{"group", false},
                     {"records"},
                     {"mean"},
                     {"sd"},
                     {"skewness"},
                     {"kurtosis", true, "3 for a normal distribution"},
                     {"normal, p", true, "Shapiro-Wilk, or Anderson-Darling of long records"},
                     {"lag-1"},
                     {"white, p", true, "Ljung-Box: small where residuals follow each other"},
                     {"runs, p"},
                     {"outliers"}});
    for (const auto& [group, entry] : diagnostics.items()) {
        const Json* normality = filled(entry, "normality");
        double normal = normality == nullptr ? std::nan("") : p_of(*normality, "shapiro_wilk");
        if (std::isnan(normal) && normality != nullptr) normal = p_of(*normality, "anderson_darling");
        const Json* outliers = filled(entry, "outliers");
        const auto cell = [&values = entry](const char* key, int digits) {
            return HtmlTable::Cell(significant(number_at(values, key), digits), number_at(values, key));
        };
        table.add({group, cell("count", 7), cell("mean", 2), cell("sd", 4), cell("skewness", 2), cell("kurtosis", 3),
                   p_cell(normal), cell("lag1", 2), p_cell(p_of(entry, "ljung_box")), p_cell(p_of(entry, "runs")),
                   std::to_string(outliers == nullptr ? 0 : outliers->size())});
    }
    return table.html();
}

std::string used_table(const Json& counts) {
    HtmlTable table("What was used", {{"residuals", false}, {"used"}, {"lost"}, {"rejected"}, {"added"}});
    for (const Json& count : counts) {
        const auto cell = [&count](const char* key) { return significant(number_at(count, key), 9); };
        table.add({text_at(count, "type"), cell("used"), cell("lost"), cell("rejected"), cell("added")});
    }
    return table.html();
}

}  // namespace

ReportChapter residual_chapter(const ReportSource& source) {
    ReportChapter chapter{"residuals", "Fit and residuals", ""};
    std::vector<Group> groups = groups_of(source.residuals);
    if (!groups.empty()) {
        const ModelJob model = stored_model(source.run);
        for (Group& group : groups)
            name_axes(group, source.run, model);
    }
    const Json* result = source.run.result ? &*source.run.result : nullptr;
    if (result != nullptr) {
        if (const Json* list = filled(*result, "residuals")) chapter.html += used_table(*list);
    }
    const std::string thinned =
        source.residuals.size() > most_rows
            ? fmt::format(" Of {} records every {}th is in this page; residuals.csv holds them all.",
                          detail::grouped(source.residuals.size()),
                          (source.residuals.size() + most_rows - 1) / most_rows)
            : "";
    chapter.html += figure_html(source, prediction_chart(groups),
                                "Observed values (dots) and what the estimated model predicts (line). Of cycles, "
                                "observed against predicted points." +
                                    thinned);
    chapter.html += figure_html(source, Chart{"waveform", "", "", {}},
                                "Measured steady states (dots) and computed ones (lines) over one turn of the orbit.");
    if (result != nullptr) {
        if (const Json* list = filled(*result, "prediction")) chapter.html += prediction_table(*list);
    }
    std::string residuals = figure_html(source, residual_chart(groups),
                                        "What is left, in standard deviations of its error. 19 of 20 should lie within "
                                        "the dashed lines, without a course that the eye can follow.");
    residuals += figure_html(source, quantile_chart(groups),
                             "The same values in their order, against those of a normal distribution: on the line when "
                             "errors are normal, above it on the right and below on the left when their tails are "
                             "heavy.");
    if (result != nullptr) {
        if (const Json* list = filled(*result, "diagnostics")) residuals += diagnostics_table(*list);
    }
    chapter.html += html_headed(3, "Residuals", residuals);
    return chapter;
}

}  // namespace orbid::apps

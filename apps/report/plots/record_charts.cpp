#include "apps/report/plots/record_charts.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <tuple>

#include <fmt/format.h>
#include <boost/math/distributions/normal.hpp>

#include "apps/drawing/waveform_plot.hpp"
#include "apps/report/plots/json_member.hpp"
#include "apps/stored_run/stored_record.hpp"

namespace orbid::apps {

namespace {

using namespace detail;

/// Pictures one may choose among; a list of more is no choice.
constexpr std::size_t most_views = 300;

/// The groups with their rows, without names for people.
std::vector<RecordGroup> grouped_rows(const std::vector<ResidualRow>& rows, std::size_t most) {
    std::vector<RecordGroup> groups;
    std::map<std::tuple<std::string, std::string, bool>, std::size_t> place;
    std::map<std::tuple<std::size_t, std::string>, std::size_t> block_place;
    const std::size_t every = catalog::stride(rows.size(), std::max<std::size_t>(1, most));
    std::map<std::size_t, std::size_t> seen;
    for (const ResidualRow& row : rows) {
        const auto [found, fresh] =
            place.try_emplace({row.experiment, row.coordinate, catalog::is_cycle(row)}, groups.size());
        if (fresh) groups.push_back({row.experiment, row.coordinate, {}, catalog::is_cycle(row)});
        if (seen[found->second]++ % every != 0) continue;
        RecordGroup& group = groups[found->second];
        const auto [block, first] = block_place.try_emplace({found->second, row.block}, group.blocks.size());
        if (first) group.blocks.push_back({row.block, {}});
        group.blocks[block->second].second.push_back(&row);
    }
    return groups;
}

/// How many residuals lie beyond 2 sds.
std::string counts_beyond(const std::vector<RecordGroup>& groups) {
    std::size_t known = 0;
    std::size_t outside = 0;
    for (const RecordGroup& group : groups) {
        for (const auto& [block, rows] : group.blocks) {
            for (const ResidualRow* row : rows) {
                if (!std::isfinite(over_sd(*row))) continue;
                ++known;
                if (std::abs(over_sd(*row)) > 2.0) ++outside;
            }
        }
    }
    return fmt::format("{} residuals over their sd, {} of them ({:.1f} %) beyond 2", known, outside,
                       known > 0 ? 100.0 * static_cast<double>(outside) / static_cast<double>(known) : 0.0);
}

/// No layers where nothing has a place.
ChartView residual_view(const RecordGroup& group) {
    ChartView view;
    ChartRange x;
    ChartRange y;
    y.include(-3.0);
    y.include(3.0);
    view.layers = {level_rule(0.0, "", Ink::soft), level_rule(1.96, "± 1.96", Ink::soft, true),
                   level_rule(-1.96, "± 1.96", Ink::soft, true)};
    ChartLayer cycles{LayerKind::points, "cycles", 2};
    std::size_t index = 0;
    for (const auto& [block, rows] : group.blocks) {
        ChartLayer layer{LayerKind::points, fmt::format("segment {}", block), 1 + static_cast<int>(index % 8)};
        ChartLayer& out = group.cycles ? cycles : layer;
        for (const ResidualRow* row : rows) {
            out.add(group.cycles ? static_cast<double>(index) : row->at, over_sd(*row));
            if (group.cycles) out.labels.push_back(block);
            x.include(out.x.back());
            y.include(out.y.back());
        }
        ++index;
        if (!group.cycles && std::any_of(layer.y.begin(), layer.y.end(), [](double v) { return std::isfinite(v); }))
            view.layers.push_back(std::move(layer));
    }
    if (group.cycles) view.layers.push_back(std::move(cycles));
    if (x.empty()) view.layers.clear();
    view.label = group.label;
    view.x = x.axis(group.cycles ? "cycles, in their order" : group.place, group.cycles ? "" : group.place_unit);
    view.x.deep = true;
    view.y = y.axis("residual / sd", "");
    view.height = 0.42;
    return view;
}

/// No layers for fewer than three residuals.
ChartView quantile_view(const RecordGroup& group) {
    constexpr std::size_t shown = 1200;  // the tails whole, of the middle every k-th: a line to the eye
    constexpr std::size_t tail = 200;
    const boost::math::normal_distribution<double> normal;
    ChartView view;
    std::vector<double> values;
    for (const auto& [block, rows] : group.blocks) {
        for (const ResidualRow* row : rows)
            if (std::isfinite(over_sd(*row))) values.push_back(over_sd(*row));
    }
    if (values.size() < 3) return view;
    std::sort(values.begin(), values.end());
    ChartLayer points{LayerKind::points, "residuals", 2};
    const auto n = values.size();
    const std::size_t every = n <= shown ? 1 : (n - 2 * tail) / (shown - 2 * tail);
    for (std::size_t k = 0; k < n; ++k) {
        if (k >= tail && k + tail < n && k % every != 0) continue;
        points.add(boost::math::quantile(normal, (static_cast<double>(k) + 0.5) / static_cast<double>(n)), values[k]);
    }
    ChartRange range;
    range.include(points.x);
    range.include(points.y);
    view.label = group.label;
    view.x = range.axis("normal quantile", "");
    view.y = range.axis("residual / sd", "");
    view.height = 0.6;
    const std::vector<double> ends{view.x.lower, view.x.upper};
    view.layers = {{LayerKind::line, "normal", 1, Ink::soft, ends, ends}, std::move(points)};
    return view;
}

ChartView course_view(const RecordGroup& group, const std::string& block, const RecordGroup::Rows& rows) {
    ChartLayer observed{LayerKind::points, "observed", 6};
    ChartLayer predicted{LayerKind::line, "predicted", 1};
    for (const ResidualRow* row : rows) {
        observed.add(row->at, row->observed);
        predicted.add(row->at, row->predicted);
    }
    ChartRange x;
    ChartRange y;
    x.include(observed.x);
    y.include(observed.y);
    y.include(predicted.y);
    ChartView view;
    view.label = group.label;
    // Experiments are told apart by their names already.
    if (group.blocks.size() > 1 || group.label == display_name(group.coordinate))
        view.label += fmt::format(", segment {}", block);
    view.x = x.axis(group.place, group.place_unit);
    view.x.deep = true;
    view.y = y.axis(display_name(group.coordinate), group.unit);
    view.height = 0.42;
    view.layers = {std::move(observed), std::move(predicted)};
    return view;
}

/// Cycles have no course: observed against predicted, where every point should lie on the line.
ChartView cycle_view(const RecordGroup& group) {
    ChartLayer points{LayerKind::points, "points of cycles", 2};
    for (const auto& [block, rows] : group.blocks) {
        for (const ResidualRow* row : rows) {
            points.add(row->predicted, row->observed);
            points.labels.push_back(block);
        }
    }
    ChartRange range;
    range.include(points.x);
    range.include(points.y);
    ChartView view;
    view.label = group.label;
    view.x = range.axis(fmt::format("{} predicted", display_name(group.coordinate)), group.unit);
    view.y = range.axis(fmt::format("{} observed", display_name(group.coordinate)), group.unit);
    view.height = 0.6;
    const std::vector<double> ends{view.x.lower, view.x.upper};
    view.layers = {{LayerKind::line, "equal", 1, Ink::soft, ends, ends}, std::move(points)};
    return view;
}

/// The readings of a steady state by coordinate, in the order of their places on the orbit.
void add_waveforms(const Json& state, const std::vector<ResidualRow>& rows, const ModelJob& model,
                   std::vector<WaveformPanel>& panels) {
    const double time = number_at(state, "time");
    const std::string experiment = text_at(state, "experiment");
    const std::string segment = text_at(state, "segment");
    if (!(time > 0.0)) return;
    const auto share = [time](const ResidualRow* row) { return row->at / time - std::floor(row->at / time); };
    std::vector<std::pair<std::string, RecordGroup::Rows>> read;
    for (const ResidualRow& row : rows) {
        if (row.experiment != experiment || row.block != segment) continue;
        auto found =
            std::find_if(read.begin(), read.end(), [&](const auto& one) { return one.first == row.coordinate; });
        if (found == read.end()) found = read.insert(read.end(), {row.coordinate, {}});
        found->second.push_back(&row);
    }
    for (auto& [name, list] : read) {
        const std::string& coordinate = name;
        auto panel = std::find_if(panels.begin(), panels.end(),
                                  [&](const WaveformPanel& one) { return one.coordinate.name == coordinate; });
        if (panel == panels.end()) {
            panel = panels.insert(panels.end(), {catalog::coordinate_of(model, name), {}});
            panel->coordinate.angle = false;
        }
        std::stable_sort(list.begin(), list.end(), [&](const auto* a, const auto* b) { return share(a) < share(b); });
        PlottedWaveform& wave = panel->waveforms.emplace_back();
        wave.label = experiment == segment ? experiment : experiment + " " + segment;
        for (const ResidualRow* row : list) {
            wave.measured_at.push_back(share(row));
            wave.measured.push_back(row->observed);
            wave.computed.push_back(row->predicted);
        }
        wave.computed_at = wave.measured_at;
    }
}

}  // namespace

double over_sd(const ResidualRow& row) {
    return row.sd > 0.0 ? (row.observed - row.predicted) / row.sd : std::nan("");
}

std::vector<RecordGroup> record_groups(const StoredRun& run, const std::vector<ResidualRow>& rows, std::size_t most) {
    std::vector<RecordGroup> groups = grouped_rows(rows, most);
    if (groups.empty()) return groups;
    const ModelJob model = stored_model(run);
    std::set<std::string> experiments;
    for (const RecordGroup& group : groups)
        experiments.insert(group.experiment);
    for (RecordGroup& group : groups) {
        // Samples are placed by time, sections by the phase of their forcing or by time.
        if (catalog::is_sampled(run, group.experiment)) {
            group.place = "time";
            group.place_unit = catalog::time_unit(model);
        }
        group.unit = catalog::coordinate_of(model, group.coordinate).unit;
        group.label = (experiments.size() > 1 ? group.experiment + ": " : "") + display_name(group.coordinate);
    }
    return groups;
}

Chart residual_chart(const std::vector<RecordGroup>& groups) {
    Chart chart{"residuals", "Residuals in standard deviations", "Coordinate", {}, Chart::Arrangement::stacked};
    for (const RecordGroup& group : groups)
        if (chart.views.size() < most_views) chart.add(residual_view(group));
    chart.description = counts_beyond(groups);
    return chart;
}

Chart quantile_chart(const std::vector<RecordGroup>& groups) {
    Chart chart{"normal_quantiles",
                "Residuals against the quantiles of the normal distribution",
                "Coordinate",
                {},
                Chart::Arrangement::tiles};
    for (const RecordGroup& group : groups)
        if (chart.views.size() < most_views) chart.add(quantile_view(group));
    chart.description = "residuals over their sd against quantiles of the normal distribution";
    return chart;
}

Chart prediction_chart(const std::vector<RecordGroup>& groups) {
    Chart chart{"prediction", "Observed and predicted values", "Record", {}, Chart::Arrangement::stacked};
    std::size_t longest = 0;
    for (const RecordGroup& group : groups) {
        for (const auto& [block, rows] : group.blocks)
            if (!group.cycles) longest = std::max(longest, rows.size());
    }
    // A block with fewer records has no course in time to look at, beside longer ones.
    const std::size_t least = std::min<std::size_t>(8, longest);
    for (const RecordGroup& group : groups) {
        if (group.cycles) {
            chart.views.push_back(cycle_view(group));
            continue;
        }
        for (const auto& [block, rows] : group.blocks)
            if (chart.views.size() < most_views && rows.size() >= least)
                chart.views.push_back(course_view(group, block, rows));
    }
    chart.description = fmt::format("{} records, measured and predicted", chart.views.size());
    return chart;
}

Chart waveform_chart(const StoredRun& run, const std::vector<ResidualRow>& rows) {
    const Json& states = block_at(run.result, "steady_states");
    if (states.empty() || rows.empty()) return {"waveform"};
    const ModelJob model = stored_model(run);
    std::vector<WaveformPanel> panels;
    for (const Json& state : states)
        add_waveforms(state, rows, model, panels);
    return waveform_chart(panels);
}

}  // namespace orbid::apps

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "apps/campaign/report/campaign_charts.hpp"

namespace orbid::apps {
namespace {

/// Places along an axis where bands of many estimates are drawn, at most.
constexpr std::size_t most_places = 40;

/// What a view shows of a parameter: its error where the truth differs between tasks, else its value.
struct ShownSeries {
    std::vector<double> x;
    std::vector<double> y;
    std::vector<double> lower;
    std::vector<double> upper;
    std::vector<std::int64_t> tasks;
    double truth = std::nan("");  ///< one for all
    bool errors = false;
};

ShownSeries shown_series(const CampaignFindings& findings, const ParameterSeries& series, const VariedAxis& axis) {
    ShownSeries out;
    const auto [least, greatest] = std::minmax_element(series.truths.begin(), series.truths.end());
    const bool known = std::none_of(series.truths.begin(), series.truths.end(), [](double x) { return std::isnan(x); });
    out.errors = known && !series.truths.empty() && *least < *greatest;
    if (known && !out.errors && !series.truths.empty()) out.truth = *least;
    const bool few = series.values.size() <= CampaignFindings::few;
    for (std::size_t k = 0; k < series.values.size(); ++k) {
        const double x = axis.values[series.rows[k]];
        if (!std::isfinite(x) || !std::isfinite(series.values[k])) continue;
        const double origin = out.errors ? series.truths[k] : 0.0;
        out.x.push_back(x);
        out.y.push_back(series.values[k] - origin);
        if (!few) continue;
        out.lower.push_back(series.lower[k] - origin);
        out.upper.push_back(series.upper[k] - origin);
        out.tasks.push_back(findings.numbers[series.rows[k]]);
    }
    return out;
}

/// The value below which a share of the numbers lies.
double quantile_of(std::vector<double>& numbers, double share) {
    const auto place = static_cast<std::size_t>(share * static_cast<double>(numbers.size() - 1) + 0.5);
    const auto at = numbers.begin() + static_cast<std::ptrdiff_t>(place);
    std::nth_element(numbers.begin(), at, numbers.end());
    return *at;
}

/// Numbers by place along the axis: each value, or equal parts of the range where there are many.
class Places {
public:
    Places(const std::vector<double>& x, bool log) : log_(log) {
        values_ = x;
        std::sort(values_.begin(), values_.end());
        values_.erase(std::unique(values_.begin(), values_.end()), values_.end());
        each_ = values_.size() <= most_places;
        if (each_) return;
        lower_ = scaled(values_.front());
        width_ = (scaled(values_.back()) - lower_) / static_cast<double>(most_places);
        values_.resize(most_places);
        for (std::size_t k = 0; k < most_places; ++k) {
            const double middle = lower_ + width_ * (static_cast<double>(k) + 0.5);
            values_[k] = log_ ? std::exp(middle) : middle;
        }
    }
    [[nodiscard]] std::size_t count() const { return values_.size(); }
    [[nodiscard]] double value(std::size_t place) const { return values_[place]; }
    [[nodiscard]] std::size_t place(double x) const {
        if (each_)
            return static_cast<std::size_t>(std::lower_bound(values_.begin(), values_.end(), x) - values_.begin());
        return std::min(most_places - 1, static_cast<std::size_t>((scaled(x) - lower_) / width_));
    }

private:
    [[nodiscard]] double scaled(double x) const { return log_ ? std::log(x) : x; }
    std::vector<double> values_;
    bool log_;
    bool each_ = true;
    double lower_ = 0;
    double width_ = 1;
};

/// Moves tasks of equal x apart, by less than a third of the way to the next value, always the same way.
void spread_equal(std::vector<double>& x) {
    std::vector<double> values = x;
    std::sort(values.begin(), values.end());
    double gap = std::numeric_limits<double>::infinity();
    for (std::size_t k = 1; k < values.size(); ++k)
        if (values[k] > values[k - 1]) gap = std::min(gap, values[k] - values[k - 1]);
    values.erase(std::unique(values.begin(), values.end()), values.end());
    if (!std::isfinite(gap) || 2 * values.size() > x.size()) return;
    // Fractions of the golden ratio are spread evenly.
    constexpr double golden = 0.6180339887498949;
    for (std::size_t k = 0; k < x.size(); ++k) {
        const double place = golden * static_cast<double>(k + 1);
        x[k] += 0.6 * gap * (place - std::floor(place) - 0.5);
    }
}

void add_each(ChartView& view, ShownSeries& shown, const std::string& name, ChartRange& range) {
    ChartLayer intervals{LayerKind::intervals, "95 % interval", 2};
    ChartLayer points{LayerKind::points, "estimate", 2};
    for (std::size_t k = 0; k < shown.x.size(); ++k)
        points.labels.push_back(fmt::format("task {}: {} = {:.6g}", shown.tasks[k], name, shown.y[k]));
    range.include(shown.lower);
    range.include(shown.upper);
    range.include(shown.y);
    intervals.x = shown.x;
    intervals.lower = std::move(shown.lower);
    intervals.upper = std::move(shown.upper);
    points.x = std::move(shown.x);
    points.y = std::move(shown.y);
    view.layers.push_back(std::move(intervals));
    view.layers.push_back(std::move(points));
}

void add_bands(ChartView& view, const ShownSeries& shown, bool log, ChartRange& range) {
    const Places places(shown.x, log);
    std::vector<std::vector<double>> at(places.count());
    for (std::size_t k = 0; k < shown.x.size(); ++k)
        at[places.place(shown.x[k])].push_back(shown.y[k]);
    ChartLayer wide{LayerKind::band, "middle 95 % of tasks", 2, Ink::soft};
    ChartLayer narrow{LayerKind::band, "middle 50 %", 2};
    ChartLayer median{LayerKind::line, "median", 2};
    for (std::size_t place = 0; place < at.size(); ++place) {
        if (at[place].empty()) continue;
        const double x = places.value(place);
        for (auto [layer, tail] : {std::pair{&wide, 0.025}, std::pair{&narrow, 0.25}}) {
            layer->x.push_back(x);
            layer->lower.push_back(quantile_of(at[place], tail));
            layer->upper.push_back(quantile_of(at[place], 1 - tail));
        }
        median.add(x, quantile_of(at[place], 0.5));
    }
    range.include(wide.lower);
    range.include(wide.upper);
    view.layers.push_back(std::move(wide));
    view.layers.push_back(std::move(narrow));
    view.layers.push_back(std::move(median));
}

ChartAxis axis_of(const VariedAxis& axis, const std::string& name, const ShownSeries& shown) {
    ChartRange range;
    range.include(shown.x);
    if (axis.numeric) return range.axis(name, "", range.lowest > 0 && range.highest > 30 * range.lowest);
    ChartAxis out{name, "", -0.5, static_cast<double>(axis.names.size()) - 0.5};
    out.whole = true;
    if (axis.names.size() <= most_drawn_groups) out.names = axis.names;
    return out;
}

}  // namespace

Chart dependence_chart(const CampaignFindings& findings, std::size_t number) {
    const VariedAxis& axis = findings.axes[number];
    const std::string name = findings.head->varied[axis.column].name;
    Chart chart{fmt::format("against-{}", number), fmt::format("Estimates against {}", name), "Parameter"};
    for (std::size_t k = 0; k < findings.parameters.size(); ++k) {
        ShownSeries shown = shown_series(findings, findings.parameters[k], axis);
        // One value along the axis is no dependence.
        if (shown.x.empty() || std::all_of(shown.x.begin(), shown.x.end(), [&](double x) { return x == shown.x[0]; }))
            continue;
        const std::string parameter = findings.groups.names()[k];
        ChartView view;
        view.label = parameter;
        view.x = axis_of(axis, name, shown);
        ChartRange range;
        range.include(shown.errors ? 0.0 : shown.truth);
        const double origin = shown.errors ? 0.0 : shown.truth;
        const bool errors = shown.errors;
        if (findings.parameters[k].values.size() <= CampaignFindings::few) {
            spread_equal(shown.x);
            add_each(view, shown, parameter, range);
        } else {
            add_bands(view, shown, view.x.log, range);
        }
        if (std::isfinite(origin)) view.layers.push_back(level_rule(origin, "truth", Ink::ink));
        view.y = range.axis(errors ? display_name(parameter) + " − truth" : display_name(parameter), "");
        chart.add(std::move(view));
    }
    return chart;
}

}  // namespace orbid::apps

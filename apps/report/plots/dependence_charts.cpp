#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <numbers>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "apps/report/plots/json_member.hpp"
#include "apps/report/plots/residual_structure.hpp"
#include "apps/stored_run/stored_inputs.hpp"
#include "apps/stored_run/stored_record.hpp"

namespace orbid::apps {

namespace {

/// A dot is some 20 characters of the page, and more of them hide each other.
constexpr std::size_t most_pictured = 600;
constexpr std::size_t most_means = 25;
constexpr std::size_t readings_per_mean = 20;
/// One choice each; the first coordinates and inputs come first.
constexpr std::size_t most_pictures = 12;
constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
/// Readings of all predicted segments together in a page: some 40 characters each, with the still picture.
constexpr std::size_t most_predicted = std::size_t{1} << 11;

/// A quantity that a residual may depend on: its value at each reading of a group, in their order.
struct Quantity {
    std::string name;
    std::string unit;
    std::vector<double> values;
};

/// Values by the place of a row in its group.
Quantity quantity(std::string name, std::string unit, const RecordGroup& group,
                  const std::function<double(const std::string& block, const RecordGroup::Rows&, std::size_t)>& value) {
    Quantity result{std::move(name), std::move(unit), {}};
    for (const auto& [block, rows] : group.blocks)
        for (std::size_t k = 0; k < rows.size(); ++k)
            result.values.push_back(value(block, rows, k));
    return result;
}

/// Predictions of another coordinate at the same instants.
Quantity state_quantity(const RecordGroup& group, const RecordGroup& other) {
    std::map<std::pair<std::string, double>, double> predicted;
    for (const auto& [block, rows] : other.blocks)
        for (const ResidualRow* row : rows)
            predicted[{block, row->at}] = row->predicted;
    return quantity(display_name(other.coordinate), other.unit, group,
                    [&](const std::string& block, const RecordGroup::Rows& rows, std::size_t k) {
                        const auto found = predicted.find({block, rows[k]->at});
                        return found == predicted.end() ? unknown : found->second;
                    });
}

/// The rate of change of the prediction, by central differences.
Quantity rate_quantity(const RecordGroup& group, bool angle) {
    const std::string unit =
        group.place_unit.empty() || group.unit.empty() ? std::string() : group.unit + "/" + group.place_unit;
    return quantity(fmt::format("rate of {}", display_name(group.coordinate)), unit, group,
                    [angle](const std::string&, const RecordGroup::Rows& rows, std::size_t k) {
                        if (k == 0 || k + 1 == rows.size()) return unknown;
                        const double step = rows[k + 1]->at - rows[k - 1]->at;
                        double change = rows[k + 1]->predicted - rows[k - 1]->predicted;
                        if (angle) change = std::remainder(change, 2.0 * std::numbers::pi);
                        return step > 0.0 ? change / step : unknown;
                    });
}

std::vector<Quantity> input_quantities(const RecordGroup& group, const StoredInputs& inputs) {
    std::vector<Quantity> list;
    std::vector<double> values(inputs.names.size());
    for (std::size_t i = 0; i < inputs.names.size(); ++i)
        list.push_back(quantity(display_name(inputs.names[i]), inputs.units[i], group,
                                [&](const std::string& block, const RecordGroup::Rows& rows, std::size_t k) {
                                    const models::InputSignal* signal = inputs.of(block);
                                    const double t = rows[k]->at;
                                    if (signal == nullptr || t < signal->first_time() || t > signal->last_time())
                                        return unknown;
                                    signal->evaluate(signal->piece_at(t), t, values.data());
                                    return values[i];
                                }));
    return list;
}

/// Means of residuals in groups of equal size along a quantity, with twice their standard error.
void add_means(const std::vector<std::pair<double, double>>& sorted, ChartLayer& band, ChartLayer& means) {
    const std::size_t count = std::min(most_means, sorted.size() / readings_per_mean);
    for (std::size_t b = 0; b < count; ++b) {
        const std::size_t begin = b * sorted.size() / count;
        const std::size_t end = (b + 1) * sorted.size() / count;
        const auto n = static_cast<double>(end - begin);
        double x = 0.0, sum = 0.0, squares = 0.0;
        for (std::size_t k = begin; k < end; ++k) {
            x += sorted[k].first / n;
            sum += sorted[k].second / n;
        }
        for (std::size_t k = begin; k < end; ++k)
            squares += std::pow(sorted[k].second - sum, 2);
        const double error = 2.0 * std::sqrt(squares / (n - 1.0) / n);
        means.add(x, sum);
        band.x.push_back(x);
        band.lower.push_back(sum - error);
        band.upper.push_back(sum + error);
    }
}

ChartView dependence_view(const RecordGroup& group, const Quantity& on) {
    ChartView view;
    std::vector<std::pair<double, double>> pairs;
    std::size_t k = 0;
    for (const auto& [block, rows] : group.blocks)
        for (const ResidualRow* row : rows) {
            const double value = on.values[k++];
            if (std::isfinite(value) && std::isfinite(over_sd(*row))) pairs.emplace_back(value, over_sd(*row));
        }
    if (pairs.size() < readings_per_mean) return view;
    ChartLayer dots{LayerKind::points, "residuals", 2};
    const std::size_t every = catalog::stride(pairs.size(), most_pictured);
    for (std::size_t i = 0; i < pairs.size(); i += every)
        dots.add(pairs[i].first, pairs[i].second);
    std::sort(pairs.begin(), pairs.end());
    ChartLayer band{LayerKind::band, "mean ± 2 standard errors", 1, Ink::soft};
    ChartLayer means{LayerKind::line, "mean", 1, Ink::ink};
    add_means(pairs, band, means);
    ChartRange x;
    ChartRange y;
    x.include(pairs.front().first);
    x.include(pairs.back().first);
    y.include(dots.y);
    y.include(-3.0);
    y.include(3.0);
    view.label = fmt::format("{} against {}", group.label, on.name);
    view.x = x.axis(on.name, on.unit);
    view.y = y.axis("residual / sd", "");
    view.height = 0.5;
    view.layers = {std::move(dots), level_rule(0.0, "", Ink::soft)};
    view.add(std::move(band));
    view.add(std::move(means));
    return view;
}

double error_of(const ResidualRow& row) {
    return row.observed - row.predicted;
}

ChartView segment_view(const RecordGroup& group, std::string label, std::vector<ChartLayer> layers) {
    ChartRange x;
    ChartRange y;
    for (const ChartLayer& layer : layers) {
        x.include(layer.x);
        y.include(layer.y);
    }
    ChartView view;
    view.label = std::move(label);
    view.x = x.axis(group.place, group.place_unit);
    view.x.deep = true;
    view.y = y.axis(display_name(group.coordinate), group.unit);
    view.height = 0.42;
    view.layers = std::move(layers);
    return view;
}

/// Measured, predicted and error over time: whole, or the first readings and then the error of every k-th of all.
/// @param most  readings of a view
void add_segment(const RecordGroup& group, const std::string& block, const RecordGroup::Rows& rows, std::size_t most,
                 Chart& chart) {
    double squares = 0.0;
    for (const ResidualRow* row : rows)
        squares += error_of(*row) * error_of(*row);
    const std::string unit = group.unit.empty() ? "" : " " + group.unit;
    const std::string label = fmt::format("{}, segment {}: rms of the error {:.4g}{}", group.label, block,
                                          std::sqrt(squares / static_cast<double>(rows.size())), unit);
    ChartLayer measured{LayerKind::points, "measured", 6};
    ChartLayer predicted{LayerKind::line, "predicted", 1};
    ChartLayer error{LayerKind::line, "error", 2};
    for (std::size_t k = 0; k < std::min(most, rows.size()); ++k) {
        measured.add(rows[k]->at, rows[k]->observed);
        predicted.add(rows[k]->at, rows[k]->predicted);
        error.add(rows[k]->at, error_of(*rows[k]));
    }
    const bool whole = rows.size() <= most;
    chart.add(segment_view(group, whole ? label : fmt::format("{}; its first {} readings", label, most),
                           {std::move(measured), std::move(predicted), std::move(error)}));
    if (whole) return;
    ChartLayer all{LayerKind::line, "error", 2};
    const std::size_t every = catalog::stride(rows.size(), most);
    for (std::size_t k = 0; k < rows.size(); k += every)
        all.add(rows[k]->at, error_of(*rows[k]));
    chart.add(segment_view(group, fmt::format("{}; the error of every {}th reading", label, every), {std::move(all)}));
}

}  // namespace

Chart dependence_chart(const StoredRun& run, const std::vector<RecordGroup>& groups) {
    Chart chart{"residual_dependence", "Residuals against inputs and state", "Residual", {}, Chart::Arrangement::tiles};
    const bool any = std::any_of(groups.begin(), groups.end(), [](const RecordGroup& one) { return !one.cycles; });
    if (!any) return chart;
    const ModelJob model = stored_model(run);
    std::map<std::string, StoredInputs> inputs;
    for (const RecordGroup& group : groups) {
        if (group.cycles || !catalog::is_sampled(run, group.experiment)) continue;
        const auto [own, fresh] = inputs.try_emplace(group.experiment);
        if (fresh) own->second = stored_inputs(run, group.experiment);
        std::vector<Quantity> list = input_quantities(group, own->second);
        for (const RecordGroup& other : groups)
            if (!other.cycles && other.experiment == group.experiment) list.push_back(state_quantity(group, other));
        list.push_back(rate_quantity(group, catalog::coordinate_of(model, group.coordinate).angle));
        for (const Quantity& one : list)
            if (chart.views.size() < most_pictures) chart.add(dependence_view(group, one));
    }
    chart.description =
        "residuals over their sd against measured inputs and predicted states: white noise has no course";
    return chart;
}

Chart segment_chart(const std::vector<RecordGroup>& groups) {
    Chart chart{"predicted_segments", "Segments that were predicted", "Segment", {}, Chart::Arrangement::stacked};
    std::size_t count = 0;
    std::size_t segments = 0;
    for (const RecordGroup& group : groups) {
        segments += group.blocks.size();
        for (const auto& [block, rows] : group.blocks)
            count += rows.size();
    }
    const std::size_t most = std::max<std::size_t>(200, most_predicted / std::max<std::size_t>(1, segments));
    for (const RecordGroup& group : groups)
        for (const auto& [block, rows] : group.blocks)
            if (chart.views.size() < most_pictures && rows.size() > 1) add_segment(group, block, rows, most, chart);
    chart.description = fmt::format("{} readings that took no part in the fit", grouped_digits(count));
    return chart;
}

}  // namespace orbid::apps

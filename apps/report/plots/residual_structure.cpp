#include "apps/report/plots/residual_structure.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

namespace orbid::apps {

namespace {

/// More lags are no more to look at, and cost time in proportion.
constexpr std::size_t most_lags = 100;
constexpr std::size_t fewest_residuals = 20;
constexpr double normal95 = 1.959963984540054;

bool is_known(const ResidualRow* row) {
    return std::isfinite(over_sd(*row));
}

std::size_t known_count(const RecordGroup& group) {
    std::size_t count = 0;
    for (const auto& [block, rows] : group.blocks)
        count += static_cast<std::size_t>(std::count_if(rows.begin(), rows.end(), is_known));
    return count;
}

std::size_t lags_of(const RecordGroup& group) {
    std::size_t longest = 0;
    for (const auto& [block, rows] : group.blocks)
        longest = std::max(longest, rows.size());
    return std::min(most_lags, longest / 4);
}

/// The interval from sample to sample: the median of the differences in time; 0: there is none.
double interval_of(const RecordGroup& group) {
    std::vector<double> steps;
    for (const auto& [block, rows] : group.blocks)
        for (std::size_t k = 1; k < rows.size(); ++k)
            steps.push_back(rows[k]->at - rows[k - 1]->at);
    if (steps.empty()) return 0.0;
    const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
    std::nth_element(steps.begin(), middle, steps.end());
    return *middle;
}

double mean_of(const RecordGroup& group) {
    double sum = 0.0;
    for (const auto& [block, rows] : group.blocks)
        for (const ResidualRow* row : rows)
            if (is_known(row)) sum += over_sd(*row);
    return sum / static_cast<double>(known_count(group));
}

/// Parzen's window at the share x of its width, x in [0, 1].
double parzen(double x) {
    return x < 0.5 ? 1.0 - 6.0 * x * x * (1.0 - x) : 2.0 * std::pow(1.0 - x, 3);
}

ChartView autocorrelation_view(const RecordGroup& group) {
    ChartView view;
    const std::vector<double> r = autocorrelation_of(group, lags_of(group));
    if (r.size() < 2) return view;
    const double band = normal95 / std::sqrt(static_cast<double>(known_count(group)));
    ChartLayer sticks{LayerKind::line, "autocorrelation", 2};
    ChartLayer ends{LayerKind::points, "autocorrelation", 2};
    ChartRange x;
    ChartRange y;
    for (const double value : {0.0, 1.0, -band, band})
        y.include(value);
    x.include(0.0);
    for (std::size_t k = 1; k < r.size(); ++k) {
        const auto lag = static_cast<double>(k);
        sticks.add(lag, 0.0);
        sticks.add(lag, r[k]);
        sticks.lift();
        ends.add(lag, r[k]);
        x.include(lag);
        y.include(r[k]);
    }
    view.label = group.label;
    view.x = x.axis("lag in samples", "");
    view.y = y.axis("autocorrelation", "");
    view.height = 0.42;
    view.layers = {level_rule(0.0, "", Ink::soft), level_rule(band, "white noise, 95 %", Ink::soft, true),
                   level_rule(-band, "white noise, 95 %", Ink::soft, true), std::move(sticks), std::move(ends)};
    return view;
}

ChartView spectrum_view(const RecordGroup& group) {
    ChartView view;
    const std::vector<double> r = autocorrelation_of(group, lags_of(group));
    const double interval = interval_of(group);
    if (r.size() < 8 || !(interval > 0.0)) return view;
    const auto width = static_cast<double>(r.size());
    double squares = 1.0;
    for (std::size_t k = 1; k < r.size(); ++k)
        squares += 2.0 * std::pow(parzen(static_cast<double>(k) / width), 2);
    // Of a smoothed value of white noise: squares / n.
    const double band = normal95 * std::sqrt(squares / static_cast<double>(known_count(group)));
    ChartLayer power{LayerKind::line, "residuals", 2};
    ChartRange y;
    for (const double value : {0.0, 1.0 - band, 1.0 + band})
        y.include(value);
    const std::size_t places = 2 * r.size();
    for (std::size_t j = 0; j <= places; ++j) {
        const double share = 0.5 * static_cast<double>(j) / static_cast<double>(places);  // of the sampling rate
        double sum = 1.0;
        for (std::size_t k = 1; k < r.size(); ++k)
            sum += 2.0 * parzen(static_cast<double>(k) / width) * r[k] *
                   std::cos(2.0 * std::numbers::pi * share * static_cast<double>(k));
        power.add(share / interval, sum);
        y.include(sum);
    }
    ChartRange x;
    x.include(power.x);
    view.label = group.label;
    view.x = x.axis("frequency", group.place_unit.empty() ? "" : "1/" + group.place_unit);
    view.y = y.axis("power over that of white noise", "");
    view.height = 0.42;
    view.layers = {level_rule(1.0, "white noise", Ink::soft),
                   level_rule(1.0 + band, "white noise, 95 %", Ink::soft, true),
                   level_rule(1.0 - band, "white noise, 95 %", Ink::soft, true), std::move(power)};
    return view;
}

}  // namespace

std::vector<double> autocorrelation_of(const RecordGroup& group, std::size_t lags) {
    const std::size_t count = group.cycles ? 0 : known_count(group);
    const double interval = interval_of(group);
    if (count < fewest_residuals || !(interval > 0.0)) return {};
    const double mean = mean_of(group);
    std::vector<double> sums(lags + 1, 0.0);
    std::vector<double> pairs(lags + 1, 0.0);
    for (const auto& [block, rows] : group.blocks) {
        for (std::size_t i = 0; i < rows.size(); ++i) {
            if (!is_known(rows[i])) continue;
            const double e = over_sd(*rows[i]) - mean;
            for (std::size_t j = i; j < rows.size() && j - i <= lags; ++j) {
                // A missing sample moves those behind it nearer.
                const double apart = (rows[j]->at - rows[i]->at) / interval;
                const double lag = std::round(apart);
                if (!(lag <= static_cast<double>(lags))) break;
                // Of a stored file that was changed, time may run backwards.
                if (lag < 0.0 || !is_known(rows[j]) || std::abs(apart - lag) > 0.1) continue;
                sums[static_cast<std::size_t>(lag)] += e * (over_sd(*rows[j]) - mean);
                pairs[static_cast<std::size_t>(lag)] += 1.0;
            }
        }
    }
    if (!(sums[0] > 0.0)) return {};
    const double variance = sums[0] / pairs[0];
    // Readings at their own times have hardly any pairs a whole number of intervals apart.
    if (lags > 0 && pairs[1] < 0.5 * pairs[0]) return {};
    std::vector<double> r(lags + 1);
    for (std::size_t k = 0; k <= lags; ++k)
        r[k] = pairs[k] > 0.0 ? sums[k] / pairs[k] / variance : 0.0;
    return r;
}

Chart autocorrelation_chart(const std::vector<RecordGroup>& groups) {
    Chart chart{"autocorrelation", "Autocorrelation of the residuals", "Coordinate", {}, Chart::Arrangement::tiles};
    for (const RecordGroup& group : groups)
        chart.add(autocorrelation_view(group));
    chart.description = "how residuals over their sd follow each other, beside the band of white noise";
    return chart;
}

Chart spectrum_chart(const std::vector<RecordGroup>& groups) {
    Chart chart{"residual_spectrum", "Spectrum of the residuals", "Coordinate", {}, Chart::Arrangement::tiles};
    for (const RecordGroup& group : groups)
        chart.add(spectrum_view(group));
    chart.description = "power of residuals over their sd by frequency, beside that of white noise";
    return chart;
}

}  // namespace orbid::apps

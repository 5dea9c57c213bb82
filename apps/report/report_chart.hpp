#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

#include "apps/drawing/plot_axis.hpp"

namespace orbid::apps {

/// An axis of a live chart of the report.
struct ChartAxis {
    std::string label;
    std::string unit;    ///< empty or "1": none shown
    double lower = 0.0;  ///< of the whole; what can be seen at most
    double upper = 1.0;
    bool log = false;
    bool circle = false;                  ///< an angle from -pi to pi: ticks at parts of pi
    bool whole = false;                   ///< only whole numbers have a meaning: ticks there
    bool deep = false;                    ///< may be enlarged 1e5 times instead of 64 times: long records
    std::vector<std::string> names = {};  ///< of the whole numbers from 0, instead of numbers
};

/// What is drawn over the axes. Which members count depends on `kind`, see apps/report/script/layers.js.
struct ChartLayer {
    std::string kind;  ///< density, points, line, band, bars, intervals, rule
    std::string name;  ///< in the legend; empty: not there. Equal names switch together
    int style = 1;     ///< 1 to 8: colour and shape of plot_marker
    std::string ink;   ///< name of a colour of the page instead: "soft", "ink"
    std::vector<double> x = {};
    std::vector<double> y = {};
    std::vector<double> lower = {};
    std::vector<double> upper = {};
    std::vector<std::string> labels = {};  ///< of points; empty, or one each
    bool open = false;                     ///< points as outlines
    bool dash = false;
    std::optional<double> at_x = {};  ///< of a rule
    std::optional<double> at_y = {};
};

/// One picture of a chart: what a reader chooses among when there are several.
struct ChartView {
    std::string label;
    ChartAxis x;
    ChartAxis y;
    std::vector<ChartLayer> layers;
    double height = 0.56;  ///< over the width
};

/// A live chart: the script of the page draws it beside the still picture.
struct Chart {
    std::string name;    ///< of the still picture in plot_catalog, and of its place in the page
    std::string title;   ///< what it shows, for those who do not see it
    std::string choice;  ///< what the views differ in: "Parameter"
    std::vector<ChartView> views;
};

/// Numbers small in a page: a plain list up to 64 of them, an even grid as first value, step and count, others as whole
/// steps between the least and the greatest, in 32 bits up to 2^16 numbers and in 16 bits beyond, base64, little
/// endian; the highest code stands for nan. Steps are 2.3e-10 and 1.5e-5 of the range.
[[nodiscard]] nlohmann::ordered_json packed_numbers(std::span<const double> values);

/// The chart as JSON for a script element: no "<" in it.
[[nodiscard]] std::string chart_text(const Chart& chart);

/// Names the lines of a chart from the top: turns `names` and the heights of all layers over, and sets the axis.
void name_lines(ChartView& view, std::vector<std::string> names);

/// Least and greatest of finite numbers, fed bit by bit.
class ChartRange : public PlotRange {
public:
    /// The range with 4 % to spare (logarithmic: of the decades); one unit around a single value or around 0.
    [[nodiscard]] ChartAxis axis(std::string label, std::string unit, bool log = false) const;
    [[nodiscard]] bool empty() const { return !(lowest <= highest); }
    /// Positive throughout and over more than `decades`: worth a logarithmic axis.
    [[nodiscard]] bool spans(double decades) const;
};

}  // namespace orbid::apps

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "orbits/records/series.hpp"

namespace orbid::apps {

/// An axis of a chart.
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
    std::vector<std::string> notes = {};  ///< of an upright axis: what a still picture says below each name
};

/// What a layer draws.
enum class LayerKind { density, points, line, band, bars, intervals, rule, cells };
/// As the data of a live chart call it.
[[nodiscard]] std::string_view name(LayerKind kind);

/// The colour of a layer: that of its style, or one of the page.
enum class Ink { of_style, soft, ink, cloud };
[[nodiscard]] std::string_view name(Ink ink);

/// What is drawn over the axes. Which members count depends on `kind`:
/// density (x, y: points shaded by how many there are), points, line (broken where a value is nan), band (from lower to
/// upper over x), bars (x: edges, one more than y), intervals (from lower to upper, at heights y or upright at x), rule
/// (over the whole frame at at_x or at_y), cells (squares around x, y, coloured by `shade`, with labels).
struct ChartLayer {
    LayerKind kind;
    std::string name;  ///< in the legend; empty: not there. Equal names switch together
    int style = 1;     ///< 1 to 8: colour and shape of plot_marker
    Ink ink = Ink::of_style;
    std::vector<double> x = {};
    std::vector<double> y = {};
    std::vector<double> lower = {};
    std::vector<double> upper = {};
    std::vector<std::string> labels = {};  ///< of points; empty, or one each
    bool open = false;                     ///< points as outlines
    bool dash = false;
    std::optional<double> at_x = {};  ///< of a rule
    std::optional<double> at_y = {};
    std::vector<double> shade = {};  ///< of cells, in [-1, 1]
    std::size_t orbits = 0;          ///< periodic orbits whose points these are: each point is drawn, the legend counts

    void add(double at, double value) {
        x.push_back(at);
        y.push_back(value);
    }
    /// Adds to a line; it breaks where an angle came round the circle.
    void follow(double at, double value, bool angle);
    /// Ends a line: what is added next is not joined to it.
    void lift();
};

/// A straight line over the whole frame.
[[nodiscard]] ChartLayer upright_rule(double at_x, std::string name, Ink ink, bool dash = false);
[[nodiscard]] ChartLayer level_rule(double at_y, std::string name, Ink ink, bool dash = false);

/// One frame of a chart: what a reader chooses among when there are several.
struct ChartView {
    std::string label;
    ChartAxis x;
    ChartAxis y;
    std::vector<ChartLayer> layers;
    double height = 0.56;  ///< over the width

    /// Adds a layer, unless it has neither points nor intervals.
    void add(ChartLayer layer) {
        if (!layer.x.empty() || !layer.lower.empty()) layers.push_back(std::move(layer));
    }
};

/// A picture as data: chart_svg() draws it still, the script of a report draws it live.
struct Chart {
    std::string name;         ///< in plot_catalog, and of its place in a page
    std::string title = {};   ///< what it shows, for those who do not see it
    std::string choice = {};  ///< what the views differ in: "Parameter"
    std::vector<ChartView> views = {};
    /// Which views a still picture has: the first one; all below each other; all side by side where the width allows
    /// it; or as the lower triangle of a matrix, row by row.
    enum class Arrangement { first, stacked, tiles, pairs } arrangement = Arrangement::first;
    std::string description = {};           ///< what is shown, in figures
    std::vector<std::string> remarks = {};  ///< below the still picture

    /// Adds a view, unless it has no layers.
    void add(ChartView view) {
        if (!view.layers.empty()) views.push_back(std::move(view));
    }
};

/// Goes on with a list in words. @param between  what parts the words from those before.
void append_words(std::string& list, const std::string& words, std::string_view between = "; ");

/// Names the lines of a chart from the top: turns `names` and the heights of all layers over, and sets the axis.
void name_lines(ChartView& view, std::vector<std::string> names);

/// Least and greatest of finite numbers, fed bit by bit.
struct ChartRange {
    double lowest = std::numeric_limits<double>::infinity();
    double highest = -std::numeric_limits<double>::infinity();

    void include(double value) {
        if (!std::isfinite(value)) return;
        lowest = std::min(lowest, value);
        highest = std::max(highest, value);
    }
    void include(std::span<const double> values) {
        for (const double value : values)
            include(value);
    }
    /// The range with 4 % to spare (logarithmic: of the decades); one unit around a single value or around 0.
    [[nodiscard]] ChartAxis axis(std::string label, std::string unit, bool log = false) const;
    /// The same of a coordinate by its name for people; an angle has the whole circle.
    [[nodiscard]] ChartAxis axis(const orbits::SeriesCoordinate& coordinate) const;
    [[nodiscard]] bool empty() const { return !(lowest <= highest); }
};

/// A coordinate's name for people: "phi" as the Greek letter, "phi_dot" as "dφ/dt", "k2_over_m" as "k2/m", others as
/// they are.
[[nodiscard]] std::string display_name(const std::string& name);

/// 1048576 -> "1 048 576". @param space  between groups of three digits.
[[nodiscard]] std::string grouped_digits(std::size_t value, const char* space = " ");

}  // namespace orbid::apps

#include "apps/drawing/chart_picture.hpp"

#include <algorithm>
#include <span>

#include "apps/drawing/chart_layer.hpp"

namespace orbid::apps {

namespace {

using Views = std::span<const ChartView>;

Views shown_views(const Chart& chart) {
    constexpr std::size_t most_stacked = 8;  // frames below each other on a page
    constexpr std::size_t most_tiles = 48;
    std::size_t most = chart.views.size();
    if (chart.arrangement == Chart::Arrangement::first) most = 1;
    if (chart.arrangement == Chart::Arrangement::stacked) most = most_stacked;
    if (chart.arrangement == Chart::Arrangement::tiles) most = most_tiles;
    return Views(chart.views).first(std::min(most, chart.views.size()));
}

/// Axes with as many ticks as there is room for; labels that would touch are left out anyway.
PlotAxis axis_across(const ChartAxis& axis, double width, double font) {
    return plot_axis(axis, std::clamp(static_cast<int>(width / (5.5 * font)), 3, 10));
}

PlotAxis axis_upwards(const ChartAxis& axis, double height, double font) {
    return plot_axis(axis, std::clamp(static_cast<int>((height / font - 3.0) / 1.8), 5, 10));
}

double widest_of(const std::vector<std::string>& words, const Figure& figure) {
    double widest = 0.0;
    for (const std::string& word : words)
        widest = std::max(widest, figure.width_of(word));
    return widest;
}

/// Height of a frame with its labels: names have lines of their own, others a share of the width.
double frame_height(const ChartView& view, const Figure& figure, double share, double least) {
    const double font = figure.font();
    const double turned = widest_of(view.x.names, figure);  // names below may stand upright
    if (view.y.names.empty()) return std::max(share * view.height * figure.width(), least * font) + turned;
    const double line = view.y.notes.empty() ? 2.0 : 2.8;
    return font * (line * (static_cast<double>(view.y.names.size()) + 0.2) + 3.5) + turned;
}

void draw_stacked(Figure& figure, Views views, const PlotStyle& style) {
    const double font = figure.font();
    const bool several = views.size() > 1;
    std::vector<PlotAxis> across;
    std::vector<PlotAxis> upwards;
    std::vector<double> heights;
    double room = 0.0;
    for (const ChartView& view : views) {
        heights.push_back(frame_height(view, figure, (several ? 0.65 : 1.1) * style.height, several ? 9.0 : 12.0));
        across.push_back(axis_across(view.x, figure.width(), font));
        upwards.push_back(axis_upwards(view.y, heights.back(), font));
        room = std::max(room, room_for(figure, upwards.back()));
    }
    for (std::size_t k = 0; k < views.size(); ++k) {
        const ChartView& view = views[k];
        // What frames below each other have in common stands under the last of them.
        const bool common = k + 1 < views.size() && across[k].label == across[k + 1].label;
        if (common) across[k].label.clear();
        Panel panel(figure, figure.row(heights[k] - (common ? 1.4 * font : 0.0)), across[k], upwards[k],
                    {true, true, false, room});
        draw_layers(panel, view.layers, style);
        if (several) panel.tag(view.label);
    }
}

/// Frames of one size, as many beside each other as are wide enough.
void draw_tiles(Figure& figure, Views views, const PlotStyle& style) {
    const double font = figure.font();
    // A frame needs room for three numbers below and a label.
    const double least = 15.0 * font;
    const auto columns = std::clamp<std::size_t>(static_cast<std::size_t>(figure.width() / least), 1, views.size());
    const double width = figure.width() / static_cast<double>(columns);
    double height = (columns == 1 ? 0.5 : 0.75) * width;
    for (const ChartView& view : views)
        if (!view.y.names.empty()) height = std::max(height, frame_height(view, figure, 0.0, 0.0));
    const bool tagged = views.size() > 1 && views[0].x.label == views[1].x.label;
    PageBox row;
    for (std::size_t k = 0; k < views.size(); ++k) {
        if (k % columns == 0) row = figure.row(height);
        const double left = width * static_cast<double>(k % columns);
        Panel panel(figure, {left, row.top, left + width, row.bottom}, axis_across(views[k].x, width, font),
                    axis_upwards(views[k].y, height, font));
        draw_layers(panel, views[k].layers, style);
        if (tagged) panel.tag(views[k].label);
    }
}

/// The lower triangle of a matrix: numbers and names to the left and below.
void draw_pairs(Figure& figure, Views views, const PlotStyle& style) {
    const double font = figure.font();
    std::size_t count = 1;
    while (count * (count + 1) / 2 < views.size())
        ++count;
    const double left = 4.6 * font;
    const double gap = 0.45 * font;
    const double side = (figure.width() - left - 0.8 * font) / static_cast<double>(count) - gap;
    std::size_t k = 0;
    for (std::size_t i = 0; i < count; ++i) {
        const bool last = i + 1 == count;
        const PageBox line = figure.row(side + (last ? 3.2 : 0.6) * font);
        for (std::size_t j = 0; j <= i && k < views.size(); ++j, ++k) {
            const double begin = left + (side + gap) * static_cast<double>(j);
            const PageBox part{j == 0 ? 0.0 : begin - gap, line.top, begin + side + gap, line.bottom};
            // The densities on the diagonal have an axis of their own, whose numbers say nothing to the eye.
            Panel panel(figure, part, plot_axis(views[k].x, 2), plot_axis(views[k].y, 2),
                        {last, j == 0 && i > 0, true, j == 0 ? left : gap, gap});
            draw_layers(panel, views[k].layers, style);
        }
    }
}

}  // namespace

std::string chart_svg(const Chart& chart, const std::string& heading, const PlotStyle& style) {
    const Views views = shown_views(chart);
    Figure figure(style);
    figure.title(heading, chart.description);
    figure.legend(legend_of(views, figure, style));
    if (chart.arrangement == Chart::Arrangement::pairs)
        draw_pairs(figure, views, style);
    else if (chart.arrangement == Chart::Arrangement::tiles)
        draw_tiles(figure, views, style);
    else
        draw_stacked(figure, views, style);
    if (chart.arrangement != Chart::Arrangement::first && views.size() < chart.views.size())
        figure.paragraph(fmt::format("The first {} of {}.", views.size(), chart.views.size()));
    for (const std::string& remark : chart.remarks)
        figure.paragraph(remark);
    return figure.svg(chart.title, chart.description);
}

}  // namespace orbid::apps

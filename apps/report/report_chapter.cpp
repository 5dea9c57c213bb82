#include "apps/report/report_chapter.hpp"

#include <fmt/format.h>

#include "apps/drawing/chart_picture.hpp"
#include "apps/drawing/markup_text.hpp"
#include "apps/report/report_chart.hpp"
#include "apps/report/report_points.hpp"
#include "apps/results/counted_noun.hpp"

namespace orbid::apps {

namespace {

/// Shown half as large again; drawn at full size, the dots of a dense section would take more of the page than
/// everything else.
PlotStyle page_style() {
    PlotStyle style;
    style.width_mm = 130.0;
    style.font_pt = 6.5;
    return style;
}

/// The points of a density as shares of the axes, in script elements.
std::string points_html(const Chart& chart, const ChartView& view, const ChartLayer& density) {
    const auto share = [](const ChartAxis& axis, double value) {
        return (value - axis.lower) / (axis.upper - axis.lower);
    };
    std::vector<std::pair<double, double>> points;
    points.reserve(density.x.size());
    for (std::size_t i = 0; i < density.x.size(); ++i)
        points.emplace_back(share(view.x, density.x[i]), share(view.y, density.y[i]));
    std::string out;
    for (const PointBlocks::Block& block : point_blocks(points).blocks)
        out += fmt::format("<script type=\"text/plain\" data-points=\"{}\" data-count=\"{}\">{}</script>\n",
                           markup_text(chart.name), block.count, block.base64);
    return out;
}

}  // namespace

std::string detail::grouped(std::size_t value) {
    return grouped_digits(value, "\u202f");  // narrow space that does not break
}

std::string detail::grouped_count(std::size_t count, std::string_view noun) {
    return apps::counted(count, noun, grouped(count));
}

std::string figure_html(const Chart& chart, std::string_view caption) {
    if (chart.views.empty()) return "";
    std::string out = fmt::format(
        "<figure id=\"plot-{0}\" data-chart=\"{0}\">\n<div class=\"still\">{1}</div>\n"
        "<figcaption>{2}</figcaption>\n</figure>\n<script type=\"application/json\" id=\"data-{0}\">{3}</script>\n",
        markup_text(chart.name), chart_svg(chart, "", page_style()), markup_text(caption), chart_text(chart));
    for (const ChartView& view : chart.views) {
        for (const ChartLayer& layer : view.layers)
            if (layer.kind == LayerKind::density) out += points_html(chart, view, layer);
    }
    return out;
}

}  // namespace orbid::apps

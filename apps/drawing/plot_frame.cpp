#include "apps/drawing/plot_frame.hpp"

#include <fmt/format.h>

#include "apps/drawing/markup_text.hpp"

namespace orbid::apps {
std::string PlotFrame::head(std::string_view title, std::string_view subtitle) const {
    return fmt::format(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" "
        "viewBox=\"0 0 {0:.0f} {1:.0f}\" role=\"img\" "
        "font-family=\"'Helvetica Neue',Helvetica,Arial,'DejaVu Sans',sans-serif\">\n"
        "<title>{2}</title>\n<rect width=\"{0:.0f}\" height=\"{1:.0f}\" fill=\"#ffffff\"/>\n"
        "<text x=\"{3:.0f}\" y=\"34\" font-size=\"21\" font-weight=\"600\" fill=\"#1d2430\">{2}</text>\n"
        "<text x=\"{3:.0f}\" y=\"58\" font-size=\"14\" fill=\"#5b6675\">{4}</text>\n",
        width, height, markup_text(title), left, markup_text(subtitle));
}

std::string PlotFrame::grid() const {
    std::string out = "<g fill=\"none\" stroke=\"#e6e9ee\">\n";
    for (const Tick& tick : x_axis.ticks) {
        out += fmt::format("<path d=\"M{:.1f} {:.1f}V{:.1f}\"/>\n", x_axis.at(tick.value, left, right), top, bottom);
    }
    for (const Tick& tick : y_axis.ticks) {
        out += fmt::format("<path d=\"M{:.1f} {:.1f}H{:.1f}\"/>\n", left, y_axis.at(tick.value, bottom, top), right);
    }
    out += "</g>\n<g font-size=\"14\" fill=\"#39424f\">\n";
    for (const Tick& tick : x_axis.ticks) {
        out += fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"middle\">{}</text>\n",
                           x_axis.at(tick.value, left, right), bottom + 20.0, tick.label);
    }
    for (const Tick& tick : y_axis.ticks) {
        out += fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"end\">{}</text>\n", left - 9.0,
                           y_axis.at(tick.value, bottom, top) + 5.0, tick.label);
    }
    out += "</g>\n<g font-size=\"15\" fill=\"#1d2430\" text-anchor=\"middle\">\n";
    out += fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\">{}</text>\n", 0.5 * (left + right), height - 14.0,
                       markup_text(x_axis.label));
    out += fmt::format("<text transform=\"translate(24 {:.1f}) rotate(-90)\">{}</text>\n</g>\n", 0.5 * (top + bottom),
                       markup_text(y_axis.label));
    return out;
}

std::string PlotFrame::border() const {
    return fmt::format(
        "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" fill=\"none\" "
        "stroke=\"#39424f\"/>\n",
        left, top, right - left, bottom - top);
}

}  // namespace orbid::apps

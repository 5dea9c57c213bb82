#include "apps/drawing/figure.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "apps/drawing/markup_text.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {

namespace {

constexpr double pt_per_mm = 72.0 / 25.4;
/// Mean width of a character of a sans serif font, in units of its size; DejaVu, the widest of the usual, has 0.6.
constexpr double character_width = 0.58;

/// With a space before each; nothing for a line without width.
std::string stroke_attributes(const Stroke& stroke) {
    if (!(stroke.width > 0.0)) return "";
    std::string out = fmt::format(" stroke=\"{}\" stroke-width=\"{:g}\"", stroke.colour, stroke.width);
    if (!stroke.dashes.empty()) out += fmt::format(" stroke-dasharray=\"{}\"", stroke.dashes);
    if (stroke.opacity < 1.0) out += fmt::format(" stroke-opacity=\"{:g}\"", stroke.opacity);
    return out;
}

}  // namespace

Figure::Figure(const PlotStyle& style)
    : width_(style.width_mm * pt_per_mm),
      font_(style.font_pt),
      titled_(style.title),
      described_(style.description),
      bottom_(0.35 * style.font_pt) {
    if (!(style.width_mm > 40.0 && style.width_mm <= 1000.0))
        throw std::invalid_argument(fmt::format("plot: width {} mm, must be in (40, 1000]", style.width_mm));
    if (!(style.font_pt >= 4.0 && style.font_pt <= 24.0))
        throw std::invalid_argument(fmt::format("plot: font of {} pt, must be in [4, 24]", style.font_pt));
}

double Figure::width_of(std::string_view text, double size) const {
    return character_width * size * font_ * static_cast<double>(shown_width(text));
}

PageBox Figure::row(double height) {
    const PageBox box{0.0, bottom_, width_, bottom_ + height};
    bottom_ += height;
    return box;
}

void Figure::title(std::string_view words, std::string_view description) {
    if (titled_ && !words.empty()) {
        const PageBox box = row(1.7 * font_);
        text(0.5 * font_, box.top + 1.15 * font_, words, {"start", 1.1, "#1d2430", true, true});
    }
    if (described_ && !description.empty()) {
        const PageBox box = row(1.6 * font_);
        text(0.5 * font_, box.top + 1.0 * font_, description, {"start", 0.94, "#5b6675"});
    }
}

void Figure::legend(const std::vector<LegendEntry>& entries) {
    if (entries.empty()) return;
    const double symbol = 1.9 * font_;
    const double gap = 1.1 * font_;
    constexpr int most_lines = 6;
    int lines = 1;
    double x = 0.7 * font_;
    PageBox line_box = row(1.55 * font_);
    for (const LegendEntry& entry : entries) {
        const double needed = symbol + width_of(entry.words, 0.94);
        if (x + needed > width_ && x > font_) {
            if (lines++ == most_lines) {
                text(std::min(x, width_ - 1.2 * font_), line_box.top + 1.08 * font_, "…");
                break;
            }
            line_box = row(1.4 * font_);
            x = 0.7 * font_;
        }
        const double middle = line_box.top + 0.75 * font_;
        if (entry.kind == LegendEntry::Kind::marker) {
            path(fmt::format("M{:.2f} {:.2f}{}", x + 0.5 * symbol, middle, entry.marker.outline),
                 entry.open ? std::string_view("#ffffff") : entry.marker.colour,
                 entry.open ? Stroke{entry.marker.colour, 0.8} : Stroke{"#ffffff", 0.4});
        } else if (entry.kind == LegendEntry::Kind::line) {
            line(x, middle, x + 0.8 * symbol, middle, entry.stroke);
        } else {
            rectangle({x, middle - 0.35 * font_, x + 0.75 * symbol, middle + 0.35 * font_}, entry.stroke.colour, {},
                      0.4);
        }
        text(x + symbol, middle + 0.33 * font_, entry.words, {"start", 0.94});
        x += needed + gap;
    }
    row(0.2 * font_);
}

void Figure::paragraph(std::string_view words) {
    std::string line;
    const auto end_line = [&] {
        const PageBox box = row(1.4 * font_);
        text(0.7 * font_, box.top + font_, line, {"start", 0.9});
        line.clear();
    };
    while (!words.empty()) {
        const auto end = std::min(words.find(' '), words.size());
        const std::string_view word = words.substr(0, end);
        words.remove_prefix(std::min(end + 1, words.size()));
        if (!line.empty() && width_of(line, 0.9) + width_of(word, 0.9) > width_ - 2.0 * font_) end_line();
        line += (line.empty() ? "" : " ") + std::string(word);
    }
    if (!line.empty()) end_line();
}

void Figure::text(double x, double y, std::string_view words, const TextStyle& style) {
    const std::string place = style.upright ? fmt::format("x=\"{:.2f}\" y=\"{:.2f}\"", x, y)
                                            : fmt::format("transform=\"translate({:.2f} {:.2f}) rotate(-90)\"", x, y);
    element("<text {} text-anchor=\"{}\" font-size=\"{:g}\" fill=\"{}\"{}>{}</text>\n", place, style.anchor,
            std::round(100.0 * style.size * font_) / 100.0, style.colour, style.bold ? " font-weight=\"600\"" : "",
            markup_text(words));
}

void Figure::path(std::string_view outline, std::string_view fill, const Stroke& stroke, std::string_view attributes) {
    if (outline.empty()) return;
    element("<path fill=\"{}\"{}{} d=\"{}\"/>\n", fill, stroke_attributes(stroke), attributes, outline);
}

void Figure::line(double x1, double y1, double x2, double y2, const Stroke& stroke) {
    path(fmt::format("M{:.2f} {:.2f}L{:.2f} {:.2f}", x1, y1, x2, y2), "none", stroke);
}

void Figure::rectangle(const PageBox& box, std::string_view fill, const Stroke& stroke, double opacity) {
    element("<rect x=\"{:.2f}\" y=\"{:.2f}\" width=\"{:.2f}\" height=\"{:.2f}\" fill=\"{}\"{}{}/>\n", box.left, box.top,
            box.width(), box.height(), fill, opacity < 1.0 ? fmt::format(" fill-opacity=\"{:g}\"", opacity) : "",
            stroke_attributes(stroke));
}

std::string Figure::svg(std::string_view title, std::string_view description) const {
    const double height = bottom_ + 0.35 * font_;
    return fmt::format(
               "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{:.2f}mm\" height=\"{:.2f}mm\" "
               "viewBox=\"0 0 {:.2f} {:.2f}\" role=\"img\" "
               "font-family=\"Helvetica,Arial,'Liberation Sans','DejaVu Sans',sans-serif\">\n"
               "<title>{}</title>\n<desc>{}</desc>\n<rect width=\"{:.2f}\" height=\"{:.2f}\" fill=\"#ffffff\"/>\n",
               width_ / pt_per_mm, height / pt_per_mm, width_, height, markup_text(title), markup_text(description),
               width_, height) +
           fmt::to_string(body_) + "</svg>\n";
}

}  // namespace orbid::apps

#include "apps/report/report_chapter.hpp"

#include <fmt/format.h>

#include "apps/drawing/markup_text.hpp"
#include "apps/report/html_text.hpp"
#include "apps/results/counted_noun.hpp"

namespace orbid::apps {

namespace detail {

double number_at(const Json& object, std::string_view key) {
    const auto found = object.find(key);
    return found != object.end() && found->is_number() ? found->get<double>()
                                                       : std::numeric_limits<double>::quiet_NaN();
}

std::string text_at(const Json& object, std::string_view key) {
    const auto found = object.find(key);
    return found != object.end() && found->is_string() ? found->get<std::string>() : std::string();
}

const Json* filled(const Json& object, std::string_view key) {
    const auto found = object.find(key);
    return found != object.end() && found->is_structured() && !found->empty() ? &*found : nullptr;
}

std::string grouped(std::size_t value) {
    std::string digits = std::to_string(value);
    for (auto at = static_cast<std::ptrdiff_t>(digits.size()) - 3; at > 0; at -= 3)
        digits.insert(static_cast<std::size_t>(at), "\u202f");  // narrow space that does not break
    return digits;
}

std::string grouped_count(std::size_t count, std::string_view noun) {
    return apps::counted(count, noun, grouped(count));
}

}  // namespace detail

std::string figure_html(const ReportSource& source, const Chart& chart, std::string_view caption,
                        const PointBlocks* blocks) {
    const auto still = source.still_plots.find(chart.name);
    const bool live = !chart.views.empty();
    if (still == source.still_plots.end() && !live) return "";
    const bool drawn = still != source.still_plots.end();
    // Without a still picture there is nothing to see until the script shows the figure.
    std::string out = fmt::format("<figure id=\"plot-{}\"{}{}>\n", markup_text(chart.name),
                                  live ? fmt::format(" data-chart=\"{}\"", markup_text(chart.name)) : "",
                                  drawn ? "" : " class=\"live-only\" hidden");
    if (drawn) out += fmt::format("<div class=\"still\">{}</div>\n", still->second);
    out += fmt::format("<figcaption>{}</figcaption>\n</figure>\n", markup_text(caption));
    if (!live) return out;
    out += fmt::format("<script type=\"application/json\" id=\"data-{}\">{}</script>\n", markup_text(chart.name),
                       chart_text(chart));
    if (blocks != nullptr) {
        for (const PointBlocks::Block& block : blocks->blocks)
            out += fmt::format("<script type=\"text/plain\" data-points=\"{}\" data-count=\"{}\">{}</script>\n",
                               markup_text(chart.name), block.count, block.base64);
    }
    return out;
}

}  // namespace orbid::apps

#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

#include "apps/drawing/chart.hpp"

namespace orbid::apps {

/// A part of the report; one without content is left out with its heading.
struct ReportChapter {
    std::string id;  ///< for links
    std::string heading;
    std::string html;
};

/// What pages of reports have in common.
struct ReportFrame {
    std::string title;
    std::string about;    ///< one line below the title
    std::string verdict;  ///< HTML before all chapters
    int refresh_s = 0;    ///< the page asks for itself again after so many seconds; 0: never
};

/// A self-contained page of HTML: style, contents, chapters, script, licences.
[[nodiscard]] std::string report_page(const ReportFrame& frame, std::span<const ReportChapter> chapters);

/// A figure: the chart drawn still, its data for the live one, a caption. Nothing for a chart without views.
[[nodiscard]] std::string figure_html(const Chart& chart, std::string_view caption);

/// Sentences about how far to trust a result, those with most weight first; each as a list item.
class ReportRemarks {
public:
    void good(std::string_view text) { add("good", "Good", text, good_); }
    void caution(std::string_view text) { add("caution", "Caution", text, caution_); }
    void bad(std::string_view text) { add("bad", "Not usable", text, bad_); }
    [[nodiscard]] std::string html() const { return bad_ + caution_ + good_; }
    [[nodiscard]] std::string html_of_faults() const { return bad_ + caution_; }

private:
    static void add(std::string_view look, std::string_view word, std::string_view text, std::string& list);

    std::string good_, caution_, bad_;
};

/// The section that a report begins with. @param summary  plain text. @param remarks  items of a list, HTML.
[[nodiscard]] std::string verdict_section(std::string_view summary, const std::string& remarks);

namespace detail {

/// 1048576 -> "1 048 576", with spaces that do not break.
[[nodiscard]] std::string grouped(std::size_t value);
/// "1 cycle", "3 cycles".
[[nodiscard]] std::string grouped_count(std::size_t count, std::string_view noun);

}  // namespace detail

}  // namespace orbid::apps

#include "apps/report/report_frame.hpp"

#include <fmt/format.h>

#include "apps/drawing/markup_text.hpp"
#include "apps/report/html_text.hpp"
#include "apps/report/report_assets.hpp"

namespace orbid::apps {

namespace {

/// A script element ends at "</script", and "<!--" hides what follows: neither is needed in code but inside a text.
std::string inside_script(std::string script) {
    for (const std::string_view word : {"</script", "<!--"}) {
        for (std::size_t at = script.find(word); at != std::string::npos; at = script.find(word, at + 2))
            script.insert(at + 1, 1, '\\');
    }
    return script;
}

}  // namespace

std::string report_page(const ReportFrame& frame, std::span<const ReportChapter> chapters) {
    std::string contents;
    std::string body;
    for (const ReportChapter& chapter : chapters) {
        if (chapter.html.empty()) continue;
        contents += fmt::format("<li><a href=\"#{}\">{}</a></li>\n", chapter.id, markup_text(chapter.heading));
        body += fmt::format(
            "<section id=\"{0}\" aria-labelledby=\"{0}-heading\">\n<h2 id=\"{0}-heading\">{1}</h2>\n{2}"
            "</section>\n",
            chapter.id, markup_text(chapter.heading), chapter.html);
    }
    std::string out = fmt::format(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
        "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
        "<meta name=\"color-scheme\" content=\"light dark\">\n<meta name=\"generator\" content=\"orbid\">\n"
        // Nothing may be loaded, whatever stands in the page; no icon is asked for.
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; "
        "script-src 'unsafe-inline'; img-src data:\">\n<link rel=\"icon\" href=\"data:,\">\n"
        "{}<title>{}</title>\n<style>\n",
        frame.refresh_s > 0 ? fmt::format("<meta http-equiv=\"refresh\" content=\"{}\">\n", frame.refresh_s) : "",
        markup_text(frame.title));
    out += report_style();
    out += fmt::format(
        "</style>\n{}</head>\n<body>\n<header>\n<h1>{}</h1>\n<p class=\"about\">{}</p>\n</header>\n"
        "<nav aria-label=\"Contents\"><ul>\n{}</ul></nav>\n<main>\n",
        // Known before the first paint: still pictures that live charts will replace are not painted at all.
        report_script().empty() ? "" : "<script>document.documentElement.className = \"scripted\"</script>\n",
        markup_text(frame.title), markup_text(frame.about), contents);
    out += frame.verdict;
    out += body;
    out += "</main>\n<footer>\n<p>Written by orbid. This page is complete in itself: it loads nothing.</p>\n";
    if (!report_licences().empty())
        out += fmt::format(
            "<details><summary>Licences of the third-party code in this page</summary><pre tabindex=\"0\">"
            "{}</pre></details>\n",
            markup_text(report_licences()));
    out += "</footer>\n";
    if (!report_script().empty())
        out += fmt::format("<script>\n{}\n</script>\n", inside_script(std::string(report_script())));
    return out + "</body>\n</html>\n";
}

void ReportRemarks::add(std::string_view look, std::string_view word, std::string_view text, std::string& list) {
    list += fmt::format("<li class=\"{}\"><strong>{}</strong> <span>{}</span></li>\n", look, word, markup_text(text));
}

std::string verdict_section(std::string_view summary, const std::string& remarks) {
    std::string out = "<section class=\"verdict\" aria-labelledby=\"verdict\">\n<h2 id=\"verdict\">In short</h2>\n";
    out += html_paragraph(summary);
    if (!remarks.empty()) out += "<ul>\n" + remarks + "</ul>\n";
    return out + "</section>\n";
}

}  // namespace orbid::apps

#include "apps/report/plots/plot_catalog.hpp"

#include <algorithm>
#include <regex>
#include <stdexcept>

#include "apps/drawing/chart_picture.hpp"
#include "apps/drawing/panel.hpp"
#include "orbits/records/data_error.hpp"
#include "tests/apps/stored_run/stored_folder.hpp"
#include "tests/catch.hpp"

namespace plot_catalog_test {

using namespace orbid::apps;
using namespace orbid::tests;

namespace {

std::vector<std::string> names(const StoredRun& run) {
    std::vector<std::string> list;
    for (const AvailablePlot& plot : available_plots(run))
        list.push_back(plot.name);
    return list;
}

std::vector<std::string> labels(const PlotAxis& axis) {
    std::vector<std::string> list;
    for (const Tick& tick : axis.ticks)
        list.push_back(tick.label);
    return list;
}

/// Tags open and close in order, attributes end, and nothing but XML's own five entities stands in texts.
bool well_formed(const std::string& xml) {
    std::vector<std::string> open;
    const std::regex tag(R"re(<(/?)([a-z]+)((?:\s+[A-Za-z0-9:_-]+="[^"<]*")*)\s*(/?)>)re");
    std::size_t covered = 0;
    for (std::sregex_iterator at(xml.begin(), xml.end(), tag); at != std::sregex_iterator(); ++at) {
        const std::string between = xml.substr(covered, static_cast<std::size_t>(at->position()) - covered);
        if (between.find_first_of("<>") != std::string::npos) return false;
        covered = static_cast<std::size_t>(at->position() + at->length());
        if ((*at)[1] == "/") {
            if (open.empty() || open.back() != (*at)[2]) return false;
            open.pop_back();
        } else if ((*at)[4] != "/") {
            open.push_back((*at)[2]);
        }
    }
    return open.empty() && xml.find_first_not_of(" \n", covered) == std::string::npos;
}

std::size_t count(const std::string& text, const std::string& what) {
    std::size_t found = 0;
    for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + what.size()))
        ++found;
    return found;
}

}  // namespace

TEST_CASE("numbers of axes on paper stay short", "[apps][plot]") {
    // Steps of 1, 2 or 5 times a power of ten, and no more than wanted.
    CHECK(labels(linear_axis("x", "m", 0.0, 1.0)) ==
          std::vector<std::string>{"0.0", "0.2", "0.4", "0.6", "0.8", "1.0"});
    CHECK(linear_axis("x", "m", 0.0, 1.0).label == "x [m]");
    CHECK(linear_axis("x", "1", 0.0, 1.0).label == "x");
    // A common power of a thousand, and a common value, go into the label.
    const PlotAxis small = linear_axis("l", "m", 0.0, 5e-7);
    CHECK(small.label == "l [10⁻⁹ m]");
    CHECK(labels(small).back() == "500");
    const PlotAxis large = linear_axis("c", "", 0.0, 4e5);
    CHECK(large.label == "c [10³]");
    const PlotAxis narrow = linear_axis("l", "m", 0.317 - 2e-10, 0.317 + 2e-10);
    CHECK(narrow.label == "l − 0.317000000 [10⁻¹² m]");
    CHECK(labels(narrow) == std::vector<std::string>{"−200", "−100", "0", "100", "200"});
    // Nothing to show still is an axis.
    const PlotAxis point = linear_axis("x", "", 2.0, 2.0);
    CHECK(point.lower < 2.0);
    CHECK(point.upper > 2.0);
    CHECK(linear_axis("x", "", std::nan(""), 1.0).upper > linear_axis("x", "", std::nan(""), 1.0).lower);
}

TEST_CASE("logarithmic axes have powers of ten, or 1, 2 and 5 where they span little", "[apps][plot]") {
    const PlotAxis decades = logarithmic_axis("s", "", 1e-3, 1e2);
    CHECK(labels(decades) == std::vector<std::string>{"10⁻³", "10⁻²", "10⁻¹", "10⁰", "10¹", "10²"});
    CHECK_THAT(decades.at(1e-3, 10.0, 20.0), orbid::tests::WithinAbs(10.0, 1e-12));
    // ln(10^1.5 / 10^-3) / ln(10^5) = 0.9 of the way.
    CHECK_THAT(decades.at(std::pow(10.0, 1.5), 10.0, 20.0), orbid::tests::WithinAbs(19.0, 1e-12));
    CHECK_FALSE(std::isfinite(decades.at(-1.0, 10.0, 20.0)));
    CHECK(labels(logarithmic_axis("s", "", 3.0, 30.0)) == std::vector<std::string>{"5", "10", "20"});
    CHECK(logarithmic_axis("s", "", 0.0, 0.0).upper > logarithmic_axis("s", "", 0.0, 0.0).lower);
    CHECK(superscript(-12) == "⁻¹²");
}

TEST_CASE("a run offers the plots that it holds the data for", "[apps][plot]") {
    const TemporaryFolder folder;
    write_stored_run(folder.path());
    CHECK(names(read_stored_run(folder.path())) ==
          std::vector<std::string>{"cycles", "multipliers", "parameters", "convergence", "correlation",
                                   "singular_values", "residuals", "normal_quantiles", "prediction"});
    std::filesystem::remove(folder.path() / "result.json");
    std::filesystem::remove(folder.path() / "residuals.csv");
    const StoredRun run = read_stored_run(folder.path());
    CHECK(names(run) == std::vector<std::string>{"cycles", "multipliers"});
    CHECK_THROWS_WITH(plot_svg(run, "parameters"), ContainsSubstring("no data for the plot \"parameters\""));
    CHECK_THROWS_WITH(plot_svg(run, "cycle"), ContainsSubstring("did you mean \"cycles\"?"));
    for (const AvailablePlot& plot : available_plots(run)) {
        const auto all = plot_names();
        CHECK(std::count(all.begin(), all.end(), plot.name) == 1);
    }
}

TEST_CASE("every plot is a self-contained picture of the size asked for", "[apps][plot]") {
    const TemporaryFolder folder;
    write_stored_run(folder.path());
    const StoredRun run = read_stored_run(folder.path());
    for (const std::string& name : names(run)) {
        CAPTURE(name);
        const std::string svg = plot_svg(run, name);
        CHECK(svg == plot_svg(run, name));
        CHECK_THAT(svg, ContainsSubstring("width=\"88.00mm\"") && ContainsSubstring("<title>"));
        CHECK(well_formed(svg));
        for (const char* foreign : {"<script", "href", "url(", " id=", "style=", "nan", "inf"})
            CHECK_THAT(svg, !ContainsSubstring(foreign));
        PlotStyle wide;
        wide.width_mm = 180.0;
        wide.title = true;
        const std::string titled = plot_svg(run, name, wide);
        CHECK_THAT(titled,
                   ContainsSubstring("width=\"180.00mm\"") && ContainsSubstring(">made &lt;by&gt; hand</text>"));
        CHECK(well_formed(titled));
    }
    CHECK_THROWS_AS(plot_svg(run, "cycles", PlotStyle{40.0, 8.0, false}), std::invalid_argument);
    CHECK_THROWS_AS(plot_svg(run, "cycles", PlotStyle{88.0, 30.0, false}), std::invalid_argument);
    CHECK_THROWS_AS(plot_svg(run, "cycles", PlotStyle{std::nan(""), 8.0, false}), std::invalid_argument);
}

TEST_CASE("what plots show is what the files hold", "[apps][plot]") {
    const TemporaryFolder folder;
    write_stored_run(folder.path(), 1.42, 0.01);
    const StoredRun run = read_stored_run(folder.path());
    // Deviations (1.42 - 1.4) / 0.01 = 2 sds and none: values beside them.
    CHECK_THAT(plot_svg(run, "parameters"), ContainsSubstring(">1.420 ± 0.01<") && ContainsSubstring(">0.300 ± 0.02<"));
    CHECK_THAT(plot_svg(run, "correlation"), ContainsSubstring(">−0.50<") && ContainsSubstring("a, b: -0.500"));
    CHECK_THAT(plot_svg(run, "cycles"), ContainsSubstring(">period 1 (1)<") && ContainsSubstring(">period 2 (1)<"));
    // Residuals over their sd are 1, -2 and 0; the missing one is not counted. -2 is not beyond 2.
    CHECK_THAT(plot_svg(run, "residuals"), ContainsSubstring("3 residuals over their sd, 0 of them (0.0 %) beyond 2"));
    CHECK_THAT(plot_svg(run, "convergence"), ContainsSubstring("2 steps of the minimisation, 1 of them refused"));
    CHECK_THAT(plot_svg(run, "multipliers"),
               ContainsSubstring("largest multipliers of 2 periodic orbits, from 1.92 to 3.01"));
}

TEST_CASE("a chart is drawn as it arranges its views", "[apps][plot]") {
    Chart chart{"name", "title"};
    for (int k = 0; k < 6; ++k) {
        ChartView view;
        view.label = "view " + std::to_string(k);
        view.x = {"x", "s", 0.0, 1.0};
        view.y = {"y", "", -1.0, 1.0};
        view.layers = {level_rule(0.0, "zero", Ink::soft, true),
                       {LayerKind::line, "line", 1, Ink::of_style, {0.0, 1.0}, {-1.0, 1.0}},
                       {LayerKind::points, "points", 2, Ink::of_style, {0.5, 0.7}, {0.0, std::nan("")}}};
        chart.views.push_back(view);
    }
    const auto svg = [&](Chart::Arrangement arrangement) {
        chart.arrangement = arrangement;
        return chart_svg(chart, "", PlotStyle{});
    };
    // The first view alone has no tag; one legend for all.
    const std::string first = svg(Chart::Arrangement::first);
    CHECK(well_formed(first));
    CHECK(count(first, "view") == count(first, "viewBox"));
    for (const char* name : {">zero<", ">line<", ">points<"})
        CHECK(count(first, name) == 1);
    // Frames below each other share the label of the axis that they have in common.
    const std::string stacked = svg(Chart::Arrangement::stacked);
    CHECK(well_formed(stacked));
    CHECK(count(stacked, ">x [s]<") == 1);
    CHECK(count(stacked, ">view 5<") == 1);
    CHECK(count(stacked, ">line<") == 1);
    const std::string tiles = svg(Chart::Arrangement::tiles);
    CHECK(well_formed(tiles));
    CHECK(count(tiles, ">x [s]<") == 6);
    // Three rows of a triangle: labels below the last one, and left of two.
    const std::string pairs = svg(Chart::Arrangement::pairs);
    CHECK(well_formed(pairs));
    CHECK(count(pairs, ">x [s]<") == 3);
    CHECK(count(pairs, ">y<") == 2);
}

TEST_CASE("a figure cuts off at frames and breaks lines where nothing is known", "[apps][plot]") {
    Figure figure(PlotStyle{100.0, 8.0, false});
    Panel panel(figure, figure.row(100.0), linear_axis("x", "", 0.0, 2.0), linear_axis("y", "", 0.0, 1.0));
    // The middle of the axes is the middle of the frame, and y grows upwards.
    CHECK_THAT(panel.x(1.0), orbid::tests::WithinAbs(0.5 * (panel.box().left + panel.box().right), 1e-9));
    CHECK(panel.y(0.9) < panel.y(0.1));
    panel.open();
    const double nan = std::nan("");
    panel.curve(std::vector{0.0, 0.5, 1.0, 1.5, 2.0}, std::vector{0.1, 0.2, nan, 0.4, 0.5}, {});
    panel.frame();
    const std::string svg = figure.svg("a & b", "c < d");
    CHECK(well_formed(svg));
    CHECK_THAT(svg, ContainsSubstring("<title>a &amp; b</title>") && ContainsSubstring("<desc>c &lt; d</desc>"));
    const std::regex curve(R"re( d="(M[^"]*)"/>\n</svg>)re");
    std::smatch found;
    REQUIRE(std::regex_search(svg, found, curve));
    CHECK(count(found[1], "M") == 2);
    CHECK(count(found[1], "L") == 2);
}

}  // namespace plot_catalog_test

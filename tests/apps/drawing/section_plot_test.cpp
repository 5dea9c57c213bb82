#include "apps/drawing/section_plot.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "apps/drawing/chart_picture.hpp"
#include "apps/drawing/plot_axis.hpp"
#include "tests/catch.hpp"

namespace orbid::section_plot_test {
namespace {

using tests::ContainsSubstring;

/// Henon map (1976), a = 1.4, b = 0.3: a chaotic section in three lines.
orbits::Series henon(Eigen::Index points) {
    orbits::Series series;
    series.coordinates = {{"x", "", false}, {"x_dot", "m/s", false}};
    Eigen::MatrixXd values(2, points);
    Eigen::Vector2d x(0.1, 0.1);
    for (Eigen::Index k = 0; k < points; ++k) {
        x = Eigen::Vector2d(1.0 - 1.4 * x[0] * x[0] + x[1], 0.3 * x[0]);
        values.col(k) = x;
    }
    series.segments.push_back({"0", values, {}});
    return series;
}

apps::SectionPicture picture_of(const orbits::Series& series) {
    return {apps::section_points(series), {}, "Section", ""};
}

/// The same with orbits of periods 1 to 9.
apps::SectionPicture with_orbits(const orbits::Series& series) {
    apps::SectionPicture picture = picture_of(series);
    // x = (-0.7 +- sqrt(0.7^2 + 4 * 1.4)) / 2.8 of x = 1 - 1.4 x^2 + 0.3 x; the other periods only to be drawn.
    const double x = (-0.7 + std::sqrt(0.49 + 5.6)) / 2.8;
    picture.add_orbit(1, Eigen::Vector2d(x, 0.3 * x));
    for (int period = 2; period <= 9; ++period)
        picture.add_orbit(period, Eigen::MatrixXd::Constant(2, period, 0.01 * period));
    return picture;
}

std::size_t count(const std::string& text, const std::string& what) {
    std::size_t found = 0;
    for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + what.size())) {
        ++found;
    }
    return found;
}

/// Opening and closing tags match in order; no attribute or text breaks out of its place.
bool well_formed(const std::string& xml) {
    std::vector<std::string> open;
    for (std::size_t at = xml.find('<'); at != std::string::npos; at = xml.find('<', at)) {
        const std::size_t end = xml.find('>', at);
        if (end == std::string::npos) {
            return false;
        }
        const std::string tag = xml.substr(at + 1, end - at - 1);
        if (std::count(tag.begin(), tag.end(), '"') % 2 != 0 || tag.find('<') != std::string::npos) {
            return false;
        }
        if (tag.front() == '/') {
            if (open.empty() || open.back() != tag.substr(1)) {
                return false;
            }
            open.pop_back();
        } else if (tag.back() != '/') {
            open.push_back(tag.substr(0, tag.find(' ')));
        }
        at = end;
    }
    return open.empty();
}

std::string drawn(const apps::SectionPicture& picture, const apps::PlotStyle& style = apps::run_picture_style) {
    return apps::chart_svg(apps::section_chart(picture), "Henon <a & b>", style);
}

TEST_CASE("the picture is well-formed, deterministic and holds legend, axes and title", "[apps]") {
    const auto series = henon(5000);
    const std::string svg = drawn(with_orbits(series));
    CHECK(svg == drawn(with_orbits(series)));
    CHECK(well_formed(svg));
    CHECK_FALSE(well_formed("<svg><g></svg>"));  // the check itself can fail
    CHECK_THAT(svg, ContainsSubstring("Henon &lt;a &amp; b&gt;") && ContainsSubstring("dx/dt [m/s]"));
    CHECK_THAT(svg, ContainsSubstring("period 1: 1 orbit<") && ContainsSubstring("period 9: 1 orbit<"));
    CHECK_THAT(svg, ContainsSubstring("5 000 points of the section, 9 periodic orbits of periods 1 to 9"));
    CHECK_THAT(svg, !ContainsSubstring("nan") && !ContainsSubstring("inf"));
    // On paper the caption says what is shown.
    const std::string plot = drawn(with_orbits(series), apps::PlotStyle{});
    CHECK_THAT(plot, ContainsSubstring(">period 9 (1)<") && !ContainsSubstring("Henon"));
}

TEST_CASE("dots are thinned, and every periodic point is drawn", "[apps]") {
    apps::SectionPicture picture = picture_of(henon(180000));
    picture.add_orbit(3, Eigen::MatrixXd::Zero(2, 3));
    const std::string svg = drawn(picture);
    // Every third point is drawn; of dots at the same twentieth of a pt one is.
    CHECK(count(svg, "h0") <= 60000);
    CHECK(count(svg, "h0") > 45000);
    // Three triangles and the one of the legend begin with the same steps: 1.2 * 5 * 0.045 * 10.5 * 1.5.
    CHECK(count(svg, "m0 -4.25l") == 3 + 1);
    // Well below the 1.5 MB a page bears.
    CHECK(svg.size() < 700000);
}

TEST_CASE("points with missing coordinates are left out, an empty series is a picture too", "[apps]") {
    auto series = henon(100);
    series.segments[0].values(0, 7) = std::numeric_limits<double>::quiet_NaN();
    CHECK(count(drawn(picture_of(series)), "h0") == 99);
    series.segments.clear();
    const std::string svg = drawn(picture_of(series));
    CHECK(well_formed(svg));
    CHECK(count(svg, "h0") == 0);
    CHECK_THAT(svg, ContainsSubstring("0 points of the section, 0 periodic orbits<"));
}

TEST_CASE("angles show the whole circle", "[apps]") {
    orbits::Series series;
    series.coordinates = {{"phi", "rad", true}, {"phi_dot", "rad/s", false}};
    series.segments.push_back({"0", (Eigen::MatrixXd(2, 2) << 0.1, 0.2, 1.0, 2.0).finished(), {}});
    const std::string svg = drawn(picture_of(series));
    CHECK_THAT(svg, ContainsSubstring(">−π<") && ContainsSubstring(">π/2<") && ContainsSubstring("φ [rad]") &&
                        ContainsSubstring("dφ/dt [rad/s]"));
    // A reading outside (-pi, pi] lands on the same dot.
    series.segments[0].values(0, 0) += 2.0 * std::acos(-1.0);
    CHECK(drawn(picture_of(series)) == svg);
}

TEST_CASE("ticks are round numbers", "[apps]") {
    const auto axis = [](double lowest, double highest) {
        return apps::plot_axis(apps::ChartRange{lowest, highest}.axis("v", "m/s"), 7);
    };
    const auto labels = [&](double lowest, double highest) {
        std::string out;
        for (const auto& tick : axis(lowest, highest).ticks)
            out += tick.label + " ";
        return out;
    };
    CHECK(labels(-14.6, 14.6) == "−15 −10 −5 0 5 10 15 ");
    CHECK(labels(0.0, 1.0) == "0.0 0.2 0.4 0.6 0.8 1.0 ");
    CHECK(labels(3.0, 3.0) == "2.85 2.90 2.95 3.00 3.05 3.10 3.15 ");
    CHECK(labels(1.0e-4, 3.0e-4) == "100 150 200 250 300 ");
    CHECK(axis(1.0e-4, 3.0e-4).label == "v [10⁻⁶ m/s]");
}

TEST_CASE("what cannot be plotted is refused", "[apps]") {
    auto series = henon(10);
    CHECK_THROWS_AS(apps::section_points(series, 0, 2), std::out_of_range);
    series.sampling = orbits::Series::Sampling::samples;
    CHECK_THROWS_WITH(apps::section_points(series), ContainsSubstring("must be a section"));
}

}  // namespace
}  // namespace orbid::section_plot_test

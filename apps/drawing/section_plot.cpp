#include "apps/drawing/section_plot.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string_view>
#include <tuple>

#include "apps/drawing/figure.hpp"

namespace orbid::apps {

namespace {

/// Light to dark, sparse to dense.
constexpr std::array<std::string_view, 5> shades{"#c3c9d2", "#a3adbb", "#8390a3", "#64738a", "#3f4d63"};

/// 1048576 -> "1 048 576".
std::string grouped(std::size_t value) {
    std::string digits = std::to_string(value);
    for (auto at = static_cast<std::ptrdiff_t>(digits.size()) - 3; at > 0; at -= 3)
        digits.insert(static_cast<std::size_t>(at), 1, ' ');
    return digits;
}

struct Dot {
    unsigned density;  ///< points of the whole section in its square
    std::size_t point;
};

/// Every k-th point, with the density there.
std::vector<Dot> thinned(const Panel& panel, const SectionPoints& points, double font) {
    // Squares of 0.35 mm on a column: small enough to follow the folds, large enough to count.
    const double cell = 0.125 * font;
    // Dots per square mm of the frame beyond which they only cover each other, and the most a page bears.
    constexpr double dense = 4.0;
    constexpr std::size_t most_of_all = 60000;
    const PageBox& box = panel.box();
    const auto columns = static_cast<std::size_t>(box.width() / cell) + 2;
    const auto rows = static_cast<std::size_t>(box.height() / cell) + 2;
    std::vector<unsigned> counts(columns * rows, 0);
    const auto square = [&](std::size_t k) -> std::ptrdiff_t {
        const double x = panel.x(points.x[k]) - box.left;
        const double y = panel.y(points.y[k]) - box.top;
        if (!(x >= 0.0 && x <= box.width() && y >= 0.0 && y <= box.height())) return -1;
        return static_cast<std::ptrdiff_t>(static_cast<std::size_t>(y / cell) * columns +
                                           static_cast<std::size_t>(x / cell));
    };
    for (std::size_t k = 0; k < points.x.size(); ++k)
        if (const auto at = square(k); at >= 0) ++counts[static_cast<std::size_t>(at)];
    const double area_mm2 = box.width() * box.height() * (25.4 / 72.0) * (25.4 / 72.0);
    const std::size_t most = std::clamp<std::size_t>(static_cast<std::size_t>(dense * area_mm2), 1, most_of_all);
    const std::size_t every = std::max<std::size_t>((points.x.size() + most - 1) / most, 1);
    std::vector<Dot> shown;
    for (std::size_t k = 0; k < points.x.size(); k += every)
        if (const auto at = square(k); at >= 0) shown.push_back({counts[static_cast<std::size_t>(at)], k});
    return shown;
}

/// Dots shaded by how many points of the whole record lie in their square.
void draw_density(Panel& panel, const SectionPoints& points, double diameter) {
    std::vector<Dot> shown = thinned(panel, points, panel.figure().font());
    std::stable_sort(shown.begin(), shown.end(), [](const Dot& a, const Dot& b) { return a.density < b.density; });
    for (std::size_t shade = 0; shade < shades.size(); ++shade) {
        // Shades hold equal numbers of dots: the picture uses its whole range whatever the density's.
        const auto begin = shown.begin() + static_cast<std::ptrdiff_t>(shown.size() * shade / shades.size());
        const auto end = shown.begin() + static_cast<std::ptrdiff_t>(shown.size() * (shade + 1) / shades.size());
        // In bands of 2 pt from left to right: steps from dot to dot are short then, and so is the path.
        constexpr double band = 2.0;
        std::sort(begin, end, [&](const Dot& a, const Dot& b) {
            const auto place = [&](const Dot& dot) {
                return std::make_tuple(std::floor(panel.y(points.y[dot.point]) / band), panel.x(points.x[dot.point]),
                                       dot.point);
            };
            return place(a) < place(b);
        });
        std::vector<double> x;
        std::vector<double> y;
        for (auto dot = begin; dot != end; ++dot) {
            x.push_back(points.x[dot->point]);
            y.push_back(points.y[dot->point]);
        }
        panel.dots(x, y, shades[shade], diameter);
    }
}

std::string counted(const SectionPicture& picture) {
    std::size_t orbits = 0;
    for (const auto& [period, points] : picture.periods)
        orbits += points.orbits;
    std::string words =
        fmt::format("{} points of the section, {} periodic orbits", grouped(picture.section.x.size()), orbits);
    if (orbits > 0)
        words += fmt::format(" of periods {} to {}", picture.periods.begin()->first, picture.periods.rbegin()->first);
    return words;
}

}  // namespace

SectionPoints section_points(const orbits::Series& series, Eigen::Index x, Eigen::Index y) {
    if (series.sampling != orbits::Series::Sampling::section)
        throw std::invalid_argument("section plot: the series holds samples, must be a section");
    SectionPoints points{
        {series.coordinates.at(static_cast<std::size_t>(x)), series.coordinates.at(static_cast<std::size_t>(y))},
        {},
        {}};
    for (const orbits::Segment& segment : series.segments) {
        for (Eigen::Index k = 0; k < segment.values.cols(); ++k) {
            if (!std::isfinite(segment.values(x, k)) || !std::isfinite(segment.values(y, k))) continue;
            points.x.push_back(segment.values(x, k));
            points.y.push_back(segment.values(y, k));
        }
    }
    return points;
}

void SectionPicture::add_orbit(int period, const Eigen::MatrixXd& points, Eigen::Index x, Eigen::Index y) {
    PeriodPoints& all = periods[period];
    ++all.orbits;
    for (Eigen::Index k = 0; k < points.cols(); ++k) {
        all.x.push_back(points(x, k));
        all.y.push_back(points(y, k));
    }
}

std::string section_svg(const SectionPicture& picture, const PlotStyle& style) {
    PlotRange x_range, y_range;
    x_range.include(picture.section.x);
    y_range.include(picture.section.y);
    for (const auto& [period, points] : picture.periods) {
        x_range.include(points.x);
        y_range.include(points.y);
    }
    const std::string description = picture.description.empty() ? counted(picture) : picture.description;
    Figure figure(style);
    figure.title(picture.heading, description);
    const double scale = 0.045 * figure.font() * style.marks;
    std::vector<LegendEntry> legend;
    for (const auto& [period, points] : picture.periods) {
        const std::string count = style.description
                                      ? fmt::format(": {} orbit{}", points.orbits, points.orbits == 1 ? "" : "s")
                                      : fmt::format(" ({})", points.orbits);
        legend.push_back({fmt::format("period {}{}", period, count),
                          LegendEntry::Kind::marker,
                          plot_marker(period, std::max(scale, 0.3)),
                          {}});
    }
    figure.legend(legend);
    const double height = 0.72 * style.height * figure.width();
    Panel panel(figure, figure.row(height), plot_axis(picture.section.coordinates[0], x_range, figure.wanted_ticks()),
                plot_axis(picture.section.coordinates[1], y_range,
                          std::max(6, static_cast<int>(height / (5.0 * figure.font())))));
    panel.open();
    draw_density(panel, picture.section, 0.07 * figure.font() * style.marks);
    panel.frame();
    // Long periods first, so that the few short ones stay visible on top; over the frame, where angles come round.
    for (auto entry = picture.periods.rbegin(); entry != picture.periods.rend(); ++entry)
        panel.markers(entry->second.x, entry->second.y, plot_marker(entry->first, scale));
    return figure.svg(picture.title, description);
}

}  // namespace orbid::apps

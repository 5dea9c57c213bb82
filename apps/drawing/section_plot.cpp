#include "apps/drawing/section_plot.hpp"

#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include "models/definition/parameter.hpp"
#include "models/system/stopped.hpp"

namespace orbid::apps {

namespace {

std::string counted(const SectionPicture& picture) {
    std::size_t orbits = 0;
    for (const auto& [period, points] : picture.periods)
        orbits += points.orbits;
    std::string words =
        fmt::format("{} points of the section, {} periodic orbits", grouped_digits(picture.section.x.size()), orbits);
    if (orbits > 0)
        words += fmt::format(" of periods {} to {}", picture.periods.begin()->first, picture.periods.rbegin()->first);
    return words;
}

void wrap(std::vector<double>& values, const orbits::SeriesCoordinate& coordinate) {
    if (!coordinate.angle) return;
    for (double& value : values)
        value = models::wrapped(value);
}

}  // namespace

SectionPoints section_points(const orbits::Series& series, Eigen::Index x, Eigen::Index y,
                             const std::function<bool()>& interrupted) {
    if (series.sampling != orbits::Series::Sampling::section)
        throw std::invalid_argument("section plot: the series holds samples, must be a section");
    SectionPoints points{
        {series.coordinates.at(static_cast<std::size_t>(x)), series.coordinates.at(static_cast<std::size_t>(y))},
        {},
        {}};
    for (const orbits::Segment& segment : series.segments) {
        for (Eigen::Index k = 0; k < segment.values.cols(); ++k) {
            if (k % 65536 == 0) models::stop_if_asked(interrupted);
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

Chart section_chart(const SectionPicture& picture) {
    const auto& [first, second] = picture.section.coordinates;
    ChartView view;
    view.add({LayerKind::density, "section", 1, Ink::cloud, picture.section.x, picture.section.y});
    // Long periods first, so that the few short ones stay visible on top.
    for (auto entry = picture.periods.rbegin(); entry != picture.periods.rend(); ++entry) {
        const auto& [period, points] = *entry;
        ChartLayer layer{
            LayerKind::points, fmt::format("period {}", period), std::clamp(period, 1, 8), Ink::of_style, points.x,
            points.y};
        layer.labels = points.labels;
        layer.orbits = points.orbits;
        view.add(std::move(layer));
    }
    ChartRange x, y;
    for (ChartLayer& layer : view.layers) {
        wrap(layer.x, first);
        wrap(layer.y, second);
        x.include(layer.x);
        y.include(layer.y);
    }
    view.x = x.axis(first);
    view.y = y.axis(second);
    view.height = 0.66;
    Chart chart{"section", picture.title, "", {}};
    chart.views.push_back(std::move(view));
    chart.description = picture.description.empty() ? counted(picture) : picture.description;
    return chart;
}

}  // namespace orbid::apps

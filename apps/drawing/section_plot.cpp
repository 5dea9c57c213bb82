#include "apps/drawing/section_plot.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <stdexcept>
#include <string_view>
#include <tuple>

#include <fmt/format.h>

#include "apps/drawing/plot_frame.hpp"
#include "apps/drawing/plot_marker.hpp"

namespace orbid::apps {
namespace {

/// Light to dark, sparse to dense.
constexpr std::array<std::string_view, 6> shades{"#b4bcc8", "#99a4b4", "#7e8b9f", "#64738a", "#4c5b74", "#35435c"};
/// Side of the squares in which the density is counted [px]: small enough to follow the folds, large enough to count.
constexpr double density_cell = 4.0;

using Out = std::back_insert_iterator<fmt::memory_buffer>;

/// 1048576 -> "1 048 576".
std::string grouped(std::size_t value) {
    std::string digits = std::to_string(value);
    for (auto at = static_cast<std::ptrdiff_t>(digits.size()) - 3; at > 0; at -= 3) {
        digits.insert(static_cast<std::size_t>(at), 1, ' ');
    }
    return digits;
}

PlotAxis axis_of(const orbits::Series& series, const std::vector<PlottedOrbit>& orbits, Eigen::Index coordinate) {
    double lowest = std::numeric_limits<double>::infinity();
    double highest = -std::numeric_limits<double>::infinity();
    const auto add = [&](const Eigen::MatrixXd& values) {
        for (Eigen::Index k = 0; k < values.cols(); ++k) {
            if (std::isfinite(values(coordinate, k))) {
                lowest = std::min(lowest, values(coordinate, k));
                highest = std::max(highest, values(coordinate, k));
            }
        }
    };
    for (const auto& segment : series.segments) {
        add(segment.values);
    }
    for (const auto& orbit : orbits) {
        add(orbit.points);
    }
    return plot_axis(series.coordinates[static_cast<std::size_t>(coordinate)], lowest, highest);
}

/// Calls visit(x px, y px) for every point without a missing coordinate.
template <class Visit>
void for_each_point(const orbits::Series& series, const SectionPlotOptions& options, const PlotFrame& frame,
                    Visit visit) {
    for (const auto& segment : series.segments) {
        for (Eigen::Index k = 0; k < segment.values.cols(); ++k) {
            const double a = segment.values(options.x, k);
            const double b = segment.values(options.y, k);
            if (std::isfinite(a) && std::isfinite(b)) {
                visit(frame.x(a), frame.y(b));
            }
        }
    }
}

/// A point of the series in tenths of a pixel.
struct Dot {
    int x;
    int y;
    unsigned density;  ///< points of the whole series in its square
};

/// Every k-th point of the series, with the density there.
std::vector<Dot> thinned(const orbits::Series& series, const SectionPlotOptions& options, const PlotFrame& frame) {
    constexpr auto columns = static_cast<std::size_t>((PlotFrame::right - PlotFrame::left) / density_cell) + 2;
    constexpr auto rows = static_cast<std::size_t>((PlotFrame::bottom - PlotFrame::top) / density_cell) + 2;
    std::vector<unsigned> counts(columns * rows, 0);
    const auto cell = [](double x, double y) {
        return static_cast<std::size_t>((y - PlotFrame::top) / density_cell) * columns +
               static_cast<std::size_t>((x - PlotFrame::left) / density_cell);
    };
    std::size_t points = 0;
    for_each_point(series, options, frame, [&](double x, double y) {
        ++counts[cell(x, y)];
        ++points;
    });
    const std::size_t every = (points + options.maximum_dots - 1) / options.maximum_dots;
    std::size_t seen = 0;
    std::vector<Dot> dots;
    for_each_point(series, options, frame, [&](double x, double y) {
        if (seen++ % every == 0) {
            dots.push_back(
                {static_cast<int>(std::lround(10.0 * x)), static_cast<int>(std::lround(10.0 * y)), counts[cell(x, y)]});
        }
    });
    return dots;
}

/// One path per shade: a dot is a line of length zero with round ends; short steps from dot to dot keep it small.
void draw_dots(std::vector<Dot> dots, Out out) {
    std::sort(dots.begin(), dots.end(),
              [](const Dot& a, const Dot& b) { return std::tie(a.density, a.y, a.x) < std::tie(b.density, b.y, b.x); });
    fmt::format_to(out, "<g transform=\"scale(.1)\" fill=\"none\" stroke-width=\"13\" stroke-linecap=\"round\">\n");
    for (std::size_t shade = 0; shade < shades.size(); ++shade) {
        // Shades hold equal numbers of dots: the picture uses its whole range whatever the density's.
        const auto begin = dots.begin() + static_cast<std::ptrdiff_t>(dots.size() * shade / shades.size());
        const auto end = dots.begin() + static_cast<std::ptrdiff_t>(dots.size() * (shade + 1) / shades.size());
        if (begin == end) {
            continue;
        }
        constexpr int band = 40;  // rows of 4 px: neighbours in a row are then near in both directions
        std::sort(begin, end, [](const Dot& a, const Dot& b) {
            return std::make_tuple(a.y / band, a.x, a.y) < std::make_tuple(b.y / band, b.x, b.y);
        });
        fmt::format_to(out, "<path stroke=\"{}\" d=\"M{} {}h0", shades[shade], begin->x, begin->y);
        for (auto dot = begin + 1; dot != end; ++dot) {
            const int dx = dot->x - (dot - 1)->x;
            const int dy = dot->y - (dot - 1)->y;
            if (dx != 0 || dy != 0) {
                fmt::format_to(out, "m{}{}{}h0", dx, dy < 0 ? "" : " ", dy);
            }
        }
        fmt::format_to(out, "\"/>\n");
    }
    fmt::format_to(out, "</g>\n");
}

using ByPeriod = std::map<int, std::vector<const PlottedOrbit*>>;

/// Long periods first, so that the few short ones stay visible on top.
void draw_orbits(const ByPeriod& periods, const SectionPlotOptions& options, const PlotFrame& frame, Out out) {
    fmt::format_to(out, "<g stroke=\"#ffffff\" stroke-width=\"1\" stroke-linejoin=\"round\">\n");
    for (auto entry = periods.rbegin(); entry != periods.rend(); ++entry) {
        const PlotMarker marker = plot_marker(entry->first);
        fmt::format_to(out, "<path fill=\"{}\" d=\"", marker.colour);
        for (const PlottedOrbit* orbit : entry->second) {
            for (Eigen::Index k = 0; k < orbit->points.cols(); ++k) {
                fmt::format_to(out, "M{:.1f} {:.1f}{}", frame.x(orbit->points(options.x, k)),
                               frame.y(orbit->points(options.y, k)), marker.outline);
            }
        }
        fmt::format_to(out, "\"/>\n");
    }
    fmt::format_to(out, "</g>\n");
}

void draw_period_legend(const ByPeriod& periods, Out out) {
    fmt::format_to(out, "<g font-size=\"14\" fill=\"#1d2430\">\n");
    // As wide as "period 12: 1234 orbits" needs, narrower when all would not fit into one line.
    const double step = std::min(
        170.0, (PlotFrame::right - PlotFrame::left) / static_cast<double>(std::max<std::size_t>(1, periods.size())));
    double x = PlotFrame::left + 8.0;
    for (const auto& [period, orbits] : periods) {
        const PlotMarker marker = plot_marker(period);
        fmt::format_to(out, "<path fill=\"{}\" stroke=\"#ffffff\" d=\"M{:.1f} 86{}\"/>\n", marker.colour, x,
                       marker.outline);
        fmt::format_to(out, "<text x=\"{:.1f}\" y=\"91\">period {}: {} orbit{}</text>\n", x + 13.0, period,
                       orbits.size(), orbits.size() == 1 ? "" : "s");
        x += step;
    }
    fmt::format_to(out, "</g>\n");
}

void require_plottable(const orbits::Series& series, const std::vector<PlottedOrbit>& orbits,
                       const SectionPlotOptions& options) {
    if (series.sampling != orbits::Series::Sampling::section) {
        throw std::invalid_argument("section plot: the series holds samples, must be a section");
    }
    for (const Eigen::Index coordinate : {options.x, options.y}) {
        if (!(coordinate >= 0 && coordinate < series.dimension())) {
            throw std::invalid_argument(
                fmt::format("section plot: coordinate {}, must be in [0, {})", coordinate, series.dimension()));
        }
    }
    if (options.maximum_dots == 0) {
        throw std::invalid_argument("section plot: maximum_dots is 0, must be > 0");
    }
    for (const auto& orbit : orbits) {
        if (orbit.points.rows() != series.dimension()) {
            throw std::invalid_argument(
                fmt::format("section plot: an orbit of period {} has {} coordinates, the series"
                            " has {}",
                            orbit.period, orbit.points.rows(), series.dimension()));
        }
    }
}

}  // namespace

std::vector<PlottedOrbit> plotted(const std::vector<orbits::Cycle>& cycles) {
    std::vector<PlottedOrbit> out;
    for (const auto& cycle : cycles) {
        out.push_back({cycle.period, cycle.points});
    }
    return out;
}

std::string section_svg(const orbits::Series& series, const std::vector<PlottedOrbit>& orbits,
                        const SectionPlotOptions& options) {
    require_plottable(series, orbits, options);
    const PlotFrame frame{axis_of(series, orbits, options.x), axis_of(series, orbits, options.y)};
    ByPeriod periods;
    for (const auto& orbit : orbits) {
        periods[orbit.period].push_back(&orbit);
    }
    const std::string title = options.title.empty() ? "Section and periodic points" : options.title;
    const std::string subtitle = options.subtitle.empty()
                                     ? fmt::format("{} points of the section, {} unstable periodic orbits",
                                                   grouped(series.size()), orbits.size())
                                     : options.subtitle;

    fmt::memory_buffer buffer;
    const Out out(buffer);
    fmt::format_to(out, "{}{}", frame.head(title, subtitle), frame.grid());
    draw_dots(thinned(series, options, frame), out);
    fmt::format_to(out, "{}", frame.border());
    draw_orbits(periods, options, frame, out);
    draw_period_legend(periods, out);
    fmt::format_to(out, "</svg>\n");
    return fmt::to_string(buffer);
}

}  // namespace orbid::apps
